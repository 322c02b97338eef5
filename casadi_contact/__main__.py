"""``python -m casadi_contact``: the command line."""

from casadi_contact.cli import main

if __name__ == "__main__":
    main()

"""``python -m casadi_contact`` and ``casadi-contact``: the command line."""

from casadi_contact.cli.main import main

if __name__ == "__main__":
    main()

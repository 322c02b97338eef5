"""``python -m casadi_contact`` and ``casadi-contact``: the command line."""

from casadi_contact.core.interrupts import end_on_interrupt


def main() -> None:
    """Entry point. What takes a second to import is imported here, so that Ctrl-C ends that quietly too."""
    end_on_interrupt()
    from casadi_contact.cli.main import main as run

    run()


if __name__ == "__main__":
    main()

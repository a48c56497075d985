"""`python -m cnnum` is the command `cnnum`."""

from cnnum.cli import main

if __name__ == "__main__":
    main()

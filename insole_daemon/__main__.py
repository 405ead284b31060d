"""`python -m insole_daemon` is the command `insole` of that Python, whatever PATH says."""

from .cli import main

if __name__ == "__main__":
    main()

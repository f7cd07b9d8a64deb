"""Run the command line: ``python -m flexstage``."""

from flexstage.cli import main

if __name__ == "__main__":
    main()

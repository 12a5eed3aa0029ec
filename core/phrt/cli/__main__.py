"""`python -m phrt.cli`."""

from phrt.cli.main import main

if __name__ == "__main__":
    main()

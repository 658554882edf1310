"""``python -m pumaid``."""

from pumaid.cli import main

if __name__ == "__main__":
    main()

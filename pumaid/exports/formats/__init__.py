"""One file a form; its name is what ``--format`` takes."""

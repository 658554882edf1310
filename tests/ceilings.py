"""What the house may cost as a whole; a room gives before another takes."""

CEILINGS = {
    "lines": 26860,
    "statements": 16712,
    "modules": 152,
    "import depth": 12,
    "lines of tests and tools": 22460,
    "words of documents": 29900,
    "class names with two meanings": 0,
    "variables named by a pronoun": 0,
}

"""What the house may cost as a whole; a room gives before another takes."""

CEILINGS = {
    "lines": 29850,
    "statements": 19013,
    "modules": 175,
    "import depth": 12,
    "lines of tests and tools": 25425,
    "words of documents": 30000,
    "class names with two meanings": 0,
    "variables named by a pronoun": 0,
}

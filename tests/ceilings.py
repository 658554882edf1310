"""What the house may cost as a whole; a room gives before another takes."""

CEILINGS = {
    "lines": 25790,
    "statements": 14906,
    "modules": 130,
    "import depth": 12,
    "lines of tests and tools": 21916,
    "words of documents": 29900,
    "class names with two meanings": 0,
    "variables named by a pronoun": 0,
}

"""What the house may cost as a whole; a room gives before another takes."""

CEILINGS = {
    "lines": 27458,
    "statements": 17190,
    "modules": 166,
    "import depth": 12,
    "lines of tests and tools": 23354,
    "words of documents": 29900,
    "class names with two meanings": 0,
    "variables named by a pronoun": 0,
}

"""What the house may cost as a whole; a room gives before another takes."""

CEILINGS = {
    "lines": 25761,
    "statements": 14875,
    "modules": 127,
    "import depth": 12,
    "lines of tests and tools": 21921,
    "words of documents": 29900,
    "class names with two meanings": 0,
    "variables named by a pronoun": 0,
}

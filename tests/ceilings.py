"""What the house may cost as a whole; a room gives before another takes."""

CEILINGS = {
    "lines": 27449,
    "statements": 17177,
    "modules": 164,
    "import depth": 12,
    "lines of tests and tools": 23352,
    "words of documents": 29900,
    "class names with two meanings": 0,
    "variables named by a pronoun": 0,
}

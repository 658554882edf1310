"""What the house may cost as a whole; a room gives before another takes."""

CEILINGS = {
    "lines": 27945,
    "statements": 17555,
    "modules": 169,
    "import depth": 12,
    "lines of tests and tools": 23450,
    "words of documents": 30000,
    "class names with two meanings": 0,
    "variables named by a pronoun": 0,
}

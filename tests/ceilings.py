"""What the house may cost as a whole; a room gives before another takes."""

CEILINGS = {
    "lines": 27915,
    "statements": 17535,
    "modules": 169,
    "import depth": 12,
    "lines of tests and tools": 25150,
    "words of documents": 30000,
    "class names with two meanings": 0,
    "variables named by a pronoun": 0,
}

"""What the house may cost as a whole; a room gives before another takes."""

CEILINGS = {
    "lines": 31628,
    "statements": 17859,
    "modules": 186,
    "import depth": 12,
    "lines of tests and tools": 27997,
    "words of documents": 30000,
    "class names with two meanings": 0,
    "variables named by a pronoun": 0,
}

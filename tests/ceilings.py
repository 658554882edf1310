"""What the house may cost as a whole; a room gives before another takes."""

CEILINGS = {
    "lines": 25722,
    "statements": 14846,
    "modules": 124,
    "import depth": 12,
    "lines of tests and tools": 21919,
    "words of documents": 29900,
    "class names with two meanings": 0,
    "variables named by a pronoun": 0,
}

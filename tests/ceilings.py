"""What the house may cost as a whole; a room gives before another takes."""

CEILINGS = {
    "lines": 25336,
    "statements": 15489,
    "modules": 125,
    "import depth": 12,
    "lines of tests and tools": 22057,
    "words of documents": 29900,
    "class names with two meanings": 0,
    "variables named by a pronoun": 0,
}

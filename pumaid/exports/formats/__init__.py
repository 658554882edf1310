"""Forms of export, by name in ``FORMS`` of each file."""

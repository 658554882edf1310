"""What moved in a log: from samples to runs."""

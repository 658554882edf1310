"""The fit: runs solved as one system, put into words with its uncertainty."""

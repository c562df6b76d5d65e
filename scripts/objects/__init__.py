"""The objects that come with vlafuzz, from shapes and patterns: `make_objects.py` builds them."""

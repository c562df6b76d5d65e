"""The values that everything is about: scenes, genes, spaces."""

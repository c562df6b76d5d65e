"""vlafuzz finds scenes in which a vision-language-action policy fails."""

__version__ = "0.1.0"

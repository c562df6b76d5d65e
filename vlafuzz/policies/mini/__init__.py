"""Mini: a small vision-language-action model that comes along, in plain torch."""

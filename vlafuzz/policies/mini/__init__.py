"""Mini: the built-in small vision-language-action model, in plain torch."""

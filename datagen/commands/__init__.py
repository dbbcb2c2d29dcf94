"""The commands of ``datagen``: their arguments, and what they do with them."""

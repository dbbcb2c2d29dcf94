"""The commands of ``datagen``, one module each: its arguments, and what it does with them."""

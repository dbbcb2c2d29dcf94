"""The commands of ``surrogate``, one module each: its arguments, and what it does with them."""

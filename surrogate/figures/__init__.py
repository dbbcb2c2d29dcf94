"""Figures of fields, errors, stresses and curves; nothing is measured or written here."""

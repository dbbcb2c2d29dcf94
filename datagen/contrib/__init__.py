"""What few use, without a promise of stability; nothing but the public names imports it."""

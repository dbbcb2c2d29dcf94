"""What a caller in Python gives to a public function, checked: types, and arrays of numbers."""

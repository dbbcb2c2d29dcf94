"""Contact with a rigid tool: normal forces, Coulomb friction, the way on which the tool comes."""

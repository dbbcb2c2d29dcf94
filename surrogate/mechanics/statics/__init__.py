"""A body at rest and under load: what it is, what acts on it, and what predicts it.

=============  ==================================================================================
`body`         mesh, supports, elements and material: equilibria, certificates, stresses
`load`         dead forces and pressures, from arrays or from the words of a command
`prediction`   what predicts a body, and its load series as one
=============  ==================================================================================
"""

"""Actuators of soft robots: forward in modes of a body, and inverse, at the rate of a controller.

===============  ============================================================
file             content
===============  ============================================================
`reduced_body`   forces and tangents of a body in modes, by a few of its cells
`bordered`       Newton's method for displacements and amplitudes together
`actuated_body`  what it needs, of a body and of its modes
`targets`        which values of actuators reach targets
`actuation`      actuators of a body, forward and inverse
`drifting_body`  a body that is stiffer than its model, under unknown loads
`seen_state`     what markers tell of it, frame by frame
`controller`     a loop from markers to actuations
===============  ============================================================
"""

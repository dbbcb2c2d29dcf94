"""Motion of a body, step by step: each step is an equilibrium with its inertia.

===============  ===========================================================
file             content
===============  ===========================================================
`moving_body`    a body in steps of one length, with some places held
`one_step`       directions from where the body coasts, until they are short
`contact`        forces of a tool in a step
`frame`          what a step has led to: state, energies, reactions
`session`        step after step, under loads, tools, grips and actuators
===============  ===========================================================
"""

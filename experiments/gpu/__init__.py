"""Everything that needs a GPU, in one resumable command for a machine that is at hand for minutes.

The machine needs Python 3.12, PyTorch 2.11 with CUDA and the usual scientific packages (NumPy,
SciPy, scikit-learn, Matplotlib, pytest); it needs no network. Beforehand, on any machine with the
datasets beam2d, lshape2d and beam3d (``make data``), make the folder that is carried there::

    python -m experiments gpu pack build/gpu --data data

It contains wheels and data, at most 64 MiB together with this repository. Then, on the machine with
the GPU, in the root of the repository::

    python3 -m pip install --no-index --find-links build/gpu/wheels \
        -r experiments/gpu/requirements.txt
    python3 -m experiments gpu run OUT --total 540   # repeat until it prints "all steps are done"
    python3 -m experiments gpu archive OUT FOLDER    # results.tar.gz, 16 MiB at most

A call ends within ``--total`` seconds. The next one goes on with the first step whose result is
not yet in OUT; a training goes on from its checkpoint. ``--list`` lists the steps with their time
limits, whose sum is less than 30 minutes, and ``--step NAME`` runs one step (again).
``--device cpu --small`` rehearses all of it.
"""

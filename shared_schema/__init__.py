"""The contract between the data factory (`datagen`) and the learner (`surrogate`).

The two programs share nothing but files; this package defines their content and is the only
code that both import. It needs h5py and numpy, and meshio for VTU files; no solver, no torch.
"""

__version__ = "0.2.0"

r"""Tetrahedra in the labels of a segmented image (NIfTI, NRRD, MetaImage), one group a label.

Every label l has the field :math:`f_l = G_σ * 1_l`, its voxels blurred by a Gaussian of the
standard deviation σ. The body's surface is that of :math:`\sum_l f_l = 1/2`, by marching cubes
(Lewiner et al. 2003, *J. Graphics Tools* 8), which gmsh fills. A cell belongs to the label with the
largest :math:`f_l` at its centre, so that neighbours have the nodes between them in common.

Blurring moves a surface against its mean curvature: a ball of radius r loses :math:`σ^2/r`.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from datagen.mesh.files.surface_file import filled
from datagen.mesh.zones import with_cell_groups
from datagen.needed import IMAGES
from shared_schema.common.bodies.groups import RawMesh
from shared_schema.common.errors import WorkError, first_line

Array = NDArray[np.float64]
SUFFIXES = (".nii", ".nii.gz", ".nrrd", ".mha")
MOST = 100  # labels, if none are named: an image with more is no segmentation
FINE = 3  # voxels along the edge of a cell that are enough
REACH = 4  # standard deviations of a Gaussian that count


def is_image(path: Path | str) -> bool:
    """True if a file name ends as that of an image."""
    return Path(path).name.lower().endswith(SUFFIXES)


def mesh_of_image(path: Path, size: float, labels: Mapping[str, int], smoothing: float) -> RawMesh:
    """Fill the labels of an image with tetrahedra.

    Parameters
    ----------
    path : Path
    size : float
        Largest edge of a cell in the image's unit, which is mm, roughly.
    labels : mapping of str to int
        Labels by the names of their groups; all others are outside. By default all but 0, whose
        groups have their numbers as names.
    smoothing : float
        Standard deviation σ in voxels, along each axis of the image; at least half of the step
        where only some voxels are looked at, since `FINE` are enough along a cell.

    Raises
    ------
    ValueError
        If the file holds no segmentation, has no such label, a label is smaller than the cells or
        vanishes by smoothing, or its surface cannot be filled.
    WorkError
        If what reads images is not installed.
    """
    try:
        from scipy.ndimage import find_objects, gaussian_filter, map_coordinates
        from skimage.measure import marching_cubes
    except ImportError as error:
        raise WorkError(f"an image needs scikit-image ({first_line(error)}); {IMAGES}") from None
    voxels, axes, origin = _read(path)
    wanted = _labels_in(voxels, labels)
    step = np.maximum(size / (FINE * np.linalg.norm(axes, axis=0)), 1).astype(int)
    sigma = np.where(step > 1, np.maximum(smoothing, step / 2), smoothing)
    (box,) = find_objects(np.isin(voxels, list(wanted.values())).astype(np.int8))
    margin = int(REACH * sigma.max()) + 2 * int(step.max())
    part = np.pad(voxels[box], margin)
    fields = [
        gaussian_filter((part == label).astype(np.float32), sigma, truncate=REACH)[
            :: step[0], :: step[1], :: step[2]
        ]
        for label in wanted.values()
    ]
    body = np.sum(fields, axis=0)
    if not body.max() > 0.5:
        raise ValueError(f"its labels vanish by smoothing over {sigma.max():g} voxels")
    corners, triangles, _, _ = marching_cubes(body, 0.5, allow_degenerate=False)
    shift = np.array([along.start for along in box]) - margin
    points = origin + (corners.astype(np.float64) * step + shift) @ axes.T
    mesh = filled(points, triangles.astype(np.int64), size)
    centres = mesh.coordinates[mesh.cells].mean(axis=1)
    centres = np.linalg.solve(axes, (centres - origin).T) - shift[:, None]
    values = [map_coordinates(field, centres / step[:, None], order=1) for field in fields]
    nearest = np.argmax(values, axis=0)
    groups = {name: np.flatnonzero(nearest == number) for number, name in enumerate(wanted)}
    for name, members in groups.items():
        if not members.size:
            raise ValueError(f"label '{name}': no cell has its centre in it, expected smaller ones")
    return with_cell_groups(mesh, groups)


def _read(path: Path) -> tuple[NDArray[Any], Array, Array]:
    """Labels of the voxels i, j, k, and edges of a voxel (in columns) and centre of the first."""
    try:
        import SimpleITK
    except ImportError as error:
        raise WorkError(f"an image needs SimpleITK ({first_line(error)}); {IMAGES}") from None
    try:
        image = SimpleITK.ReadImage(str(path))
    except RuntimeError:  # says more than fits in a line
        raise ValueError("SimpleITK reads no image from it") from None
    if image.GetDimension() != 3 or image.GetNumberOfComponentsPerPixel() != 1:
        raise ValueError(
            f"an image of {image.GetDimension()} dimensions with "
            f"{image.GetNumberOfComponentsPerPixel()} values a voxel, expected 3 and one label"
        )
    voxels = SimpleITK.GetArrayFromImage(image).T
    if not np.issubdtype(voxels.dtype, np.integer):
        if not np.array_equal(voxels, np.rint(voxels)):  # a NaN differs from itself
            raise ValueError("a voxel has another value than a whole number, expected labels")
        voxels = voxels.astype(np.int64)
    axes = np.reshape(image.GetDirection(), (3, 3)) * image.GetSpacing()
    return voxels, axes, np.array(image.GetOrigin())


def _labels_in(voxels: NDArray[Any], labels: Mapping[str, int]) -> dict[str, int]:
    """Names and numbers of the labels that are wanted of an image."""
    there = [label for label in np.unique(voxels).tolist() if label != 0]
    if not there:
        raise ValueError("all voxels are 0, expected those of a segmentation")
    for name, label in labels.items():
        if label not in there:
            named = ", ".join(map(str, there[:MOST]))
            raise ValueError(f"labels.{name} = {label}: no voxel has it, expected one of {named}")
    if not labels and len(there) > MOST:
        raise ValueError(f"{len(there)} different labels, expected some of them as 'labels'")
    return dict(labels) or {str(label): label for label in there}

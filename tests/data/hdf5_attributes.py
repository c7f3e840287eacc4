"""Writes HDF5 files whose attributes and datasets place and explain a volume.

    python hdf5_attributes.py FOLDER

itk.h5: 5 x 4 x 3 voxels counted from 0, written by SimpleITK with spacing, origin and directions.
survey.nc: 6 crosslines x 5 inlines x 7 samples counted from 0, written by xarray as segysak does; inlines descend.
levels.h5: levels of BigDataViewer whose factors are floats of 32 bits (s00) and integers (s01), and `element_size_um` of integers.
"""

import sys
from pathlib import Path

import h5py
import numpy as np
import SimpleITK as sitk
import xarray as xr

FOLDER = Path(sys.argv[1])

image = sitk.GetImageFromArray(np.arange(60, dtype="i2").reshape(3, 4, 5))
image.SetSpacing((0.5, 1.5, 2.5))
image.SetOrigin((10, 20, 30))
image.SetDirection((0, -1, 0, 1, 0, 0, 0, 0, 1))
sitk.WriteImage(image, str(FOLDER / "itk.h5"))

lines = ("iline", "xline")
survey = xr.Dataset(
    {"data": ((*lines, "twt"), np.arange(210, dtype="f4").reshape(5, 6, 7))},
    coords={
        "iline": np.arange(14, 4, -2),
        "xline": np.arange(20, 26),
        "twt": np.arange(7) * 4.0,
        "cdp_x": (lines, np.broadcast_to(1000 + 12.5 * np.arange(6), (5, 6))),
        "cdp_y": (lines, np.broadcast_to(5000 + 25.0 * np.arange(5)[:, None], (5, 6))),
    },
    attrs={"d3_domain": "TWT"},
)
survey.to_netcdf(FOLDER / "survey.nc")

with h5py.File(FOLDER / "levels.h5", "w") as file:
    for setup, kind in (("s00", "f4"), ("s01", "i4")):
        file[f"{setup}/resolutions"] = np.array([[1, 1, 1], [2, 2, 1]], dtype=kind)
        for level, shape in enumerate([(4, 8, 8), (4, 4, 4)]):
            file[f"t00000/{setup}/{level}/cells"] = np.full(shape, -25536, "i2")
    file["sized"] = np.zeros((4, 5, 6), "u1")
    file["sized"].attrs["element_size_um"] = np.array([3, 2, 1])

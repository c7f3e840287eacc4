"""Makes, by h5py, FOLDER/old.h5 and FOLDER/new.h5: one volume in many ways, in the oldest and the newest layout of the format; and
FOLDER/seed.h5, which fuzzing begins with; FOLDER/kinds.h5, of what only Python writes, and FOLDER/complex.h5 and FOLDER/virtual.h5, which
are refused."""
import sys
import h5py, numpy as np

z, y, x = np.mgrid[0:9, 0:10, 0:12]
volume = 3 * x + 5 * y + 7 * z + x * y * z % 11
for name, libver in [("old", "earliest"), ("new", "latest")]:
    with h5py.File(f"{sys.argv[1]}/{name}.h5", "w", libver=libver) as file:
        file.create_dataset("plain", data=volume.astype("<u2"))
        file.create_dataset("big", data=volume.astype(">i4"))
        made = file.create_dataset("a/gzip", data=volume.astype("<f4"), chunks=(4, 5, 8), compression="gzip", shuffle=True)
        made.attrs["element_size_um"] = [2.0, 0.5, 0.25]
        file.create_dataset("a/checked", data=volume.astype("<i2"), chunks=(9, 10, 12), fletcher32=True)
        file.create_dataset("a/whole", data=volume.astype("<i8") - 5, chunks=(2, 10, 12), compression="gzip")
        file.create_dataset("a/five", data=np.array([[volume + c + 10 * t for c in range(2)] for t in range(2)]).astype("u1"),
                            chunks=(1, 1, 9, 10, 12), maxshape=(None, 2, 9, 10, 12))
        holes = file.create_dataset("a/holes", shape=(9, 10, 12), dtype="<f8", chunks=(5, 5, 6), fillvalue=-7.0)
        holes[0:5, 0:5, 0:6] = volume[0:5, 0:5, 0:6]
        file.create_dataset("s00/resolutions", data=np.array([[1, 1, 1], [2, 2, 1.0]]))
        file.create_dataset("t00000/s00/1/cells", data=volume.astype("<i2"), chunks=(4, 4, 4), compression="gzip")
        file.create_dataset("text", data=[b"no", b"numbers"])
        file["elsewhere"] = h5py.ExternalLink("other.h5", "/a")

with h5py.File(f"{sys.argv[1]}/seed.h5", "w", libver="earliest") as file:
    file.create_dataset("v", data=np.arange(64, dtype="<u2").reshape(2, 4, 8), chunks=(2, 4, 4), compression="gzip", shuffle=True)

with h5py.File(f"{sys.argv[1]}/kinds.h5", "w", libver="earliest") as file:
    file.create_dataset("lzf", data=volume.astype("<u2"), chunks=(4, 5, 8), compression="lzf", shuffle=True)
    file.create_dataset("mask", data=volume % 2 == 1, chunks=(9, 10, 12), compression="gzip")
with h5py.File(f"{sys.argv[1]}/complex.h5", "w", libver="earliest") as file:
    file.create_dataset("k_space", data=np.ones((2, 3, 4), "c8"))
with h5py.File(f"{sys.argv[1]}/virtual.h5", "w", libver="latest") as file:
    layout = h5py.VirtualLayout((9, 10, 12), "<u2")
    layout[...] = h5py.VirtualSource("old.h5", "plain", (9, 10, 12))
    file.create_virtual_dataset("v", layout)

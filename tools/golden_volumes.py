#!/usr/bin/env python3
"""Golden values for the tests of crates/volume-io, computed with SimpleITK, pynrrd and pydicom, and not with our code.

    tools/golden_volumes.py ../shared/data

makes a virtual environment in .venv with what it needs, and writes into crates/volume-io/tests/fixtures:
nrrd/ and metaimage/, small files of each kind of header and geometry, and volumes.json: for these and for the files of
the data folder the dimensions, the patient positions (LPS, mm) of some voxels, the values there (float64), and minimum,
maximum and mean. Numbers are text, so that every digit of a float64 survives. (NIfTI: tools/golden_geometry.py.)
"""

import gzip
import json
import os
import pathlib
import subprocess
import sys
import venv

ROOT = pathlib.Path(__file__).resolve().parent.parent
VENV = ROOT / ".venv"
NEEDED = ["numpy==2.4.6", "SimpleITK==2.5.7", "pynrrd==1.1.3", "nibabel==5.4.2", "pydicom==3.0.2"]
if pathlib.Path(sys.prefix) != VENV:
    if not (VENV / "bin/python").exists():
        venv.create(VENV, with_pip=True)
    subprocess.run([VENV / "bin/python", "-m", "pip", "install", "--quiet", *NEEDED], check=True)
    os.execv(VENV / "bin/python", [VENV / "bin/python", __file__, *sys.argv[1:]])

import nrrd
import numpy as np
import SimpleITK as sitk

FIXTURES = ROOT / "crates/volume-io/tests/fixtures"
VOXELS_A_FILE = 20
DIMS = (4, 3, 5)


def rotation(axis, degrees):
    axis = np.asarray(axis, float) / np.linalg.norm(axis)
    k = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
    t = np.radians(degrees)
    return np.eye(3) + np.sin(t) * k + (1 - np.cos(t)) * (k @ k)


SPACING = np.diag([0.7, 0.8, 2.5])
ORIGIN = [-30.5, 12.25, 7.0]
# Columns are the axes' steps in the file's own space.
GEOMETRIES = {
    "axial": SPACING,
    "oblique": rotation([1, 2, 3], 25) @ SPACING,
    "flipped": np.diag([-0.7, 0.8, -2.5]),
    "left_handed": rotation([3, -1, 2], 40) @ np.diag([0.7, 0.8, -2.5]),
    "sagittal": np.array([[0, 0, 1.2], [0.9, 0, 0], [0, 0.9, 0]]),
    "coronal": np.array([[1.1, 0, 0], [0, 0, -3], [0, 1.1, 0]]),
    "sheared": np.array([[0.5, 0, 0], [0, 0.5, 1.2], [0, 0, 2.4]]),
}


def samples(name, dtype, shape=DIMS):
    """Stored numbers, different for each file, x fastest."""
    random = np.random.default_rng(sum(name.encode()))
    dtype = np.dtype(dtype)
    if dtype.kind == "f":
        return (random.integers(-16000, 24000, shape) / 8).astype(dtype)
    info = np.iinfo(dtype)
    return random.integers(max(info.min, -2000), min(info.max, 3000), shape, endpoint=True).astype(dtype)


def payload(array, order, encoding):
    if encoding == "ascii":
        return (" ".join(str(v) for v in array.flatten(order="F")) + "\n").encode()
    raw = array.astype(array.dtype.newbyteorder(order)).tobytes(order="F")
    return gzip.compress(raw, 9, mtime=0) if encoding == "gzip" else raw


def nrrd_header(array, order, encoding, fields):
    names = {"u1": "uchar", "i1": "signed char", "i2": "short", "u2": "uint16", "i4": "int", "f4": "float", "f8": "double",
             "u4": "unsigned int"}
    lines = ["NRRD0005", "# made by tools/golden_volumes.py", f"type: {names[array.dtype.str[1:]]}", f"dimension: {array.ndim}",
             "sizes: " + " ".join(map(str, array.shape)), f"encoding: {encoding}"]
    if array.dtype.itemsize > 1:
        lines.append("endian: " + {"<": "little", ">": "big"}[order])
    return "\n".join(lines + fields) + "\n"


def directions(matrix, origin, space):
    steps = " ".join("(" + ",".join(repr(float(c)) for c in matrix[:, a]) + ")" for a in range(3))
    return [f"space: {space}", f"space directions: {steps}", "space origin: (" + ",".join(map(repr, origin)) + ")"]


def nrrd_files(folder):
    lps, ras, las = "left-posterior-superior", "right-anterior-superior", "LAS"
    attached = [
        ("le_i16_axial.nrrd", "i2", "<", "raw", lps, "axial"),
        ("be_u16_ras_oblique.nrrd", "u2", ">", "gzip", ras, "oblique"),
        ("le_f32_las_left_handed.nrrd", "f4", "<", "ascii", las, "left_handed"),
        ("be_f64_flipped.nrrd", "f8", ">", "gzip", lps, "flipped"),
        ("le_i32_ras_sagittal.nrrd", "i4", "<", "raw", ras, "sagittal"),
        ("i8_coronal.nrrd", "i1", "<", "gzip", lps, "coronal"),
        ("be_i16_ascii_ras_coronal.nrrd", "i2", ">", "ascii", ras, "coronal"),
    ]
    for name, dtype, order, encoding, space, geometry in attached:
        array = samples(name, dtype)
        head = nrrd_header(array, order, encoding, directions(GEOMETRIES[geometry], ORIGIN, space))
        (folder / name).write_bytes(head.encode() + b"\n" + payload(array, order, encoding))
        yield name

    name = "u8_spacings_and_mins.nrrd"
    array = samples(name, "u1")
    fields = ["spacings: 0.5 0.75 3", "axis mins: 10 20 -30"]
    (folder / name).write_bytes(nrrd_header(array, "<", "raw", fields).encode() + b"\n" + payload(array, "<", "raw"))
    yield name

    here = directions(GEOMETRIES["oblique"], ORIGIN, ras)
    name = "detached.nhdr"
    array = samples(name, "i2")
    (folder / name).write_text(nrrd_header(array, ">", "raw", [*here, "byte skip: -1", "data file: ./detached.raw"]))
    (folder / "detached.raw").write_bytes(b"a header of its own\n" + payload(array, ">", "raw"))
    yield name

    name = "detached_gzip.nhdr"
    array = samples(name, "u2")
    (folder / name).write_text(nrrd_header(array, "<", "gzip", [*here, "data file: detached.raw.gz"]))
    (folder / "detached.raw.gz").write_bytes(payload(array, "<", "gzip"))
    yield name

    for name, data in [("listed.nhdr", "LIST\n" + "\n".join(f"slices/s{i}.raw" for i in range(DIMS[2]))),
                       ("numbered.nhdr", "slices/n%03d.raw 8 0 -2")]:
        array = samples(name, "i2")
        (folder / name).write_text(nrrd_header(array, "<", "raw", [*here, f"data file: {data}"]))
        (folder / "slices").mkdir(exist_ok=True)
        for i in range(DIMS[2]):
            file = f"s{i}.raw" if name[0] == "l" else f"n{8 - 2 * i:03d}.raw"
            (folder / "slices" / file).write_bytes(payload(array[:, :, i : i + 1], "<", "raw"))
        yield name


def metaimage_header(array, order, matrix, origin, fields, data):
    names = {"u1": "MET_UCHAR", "i1": "MET_CHAR", "i2": "MET_SHORT", "u2": "MET_USHORT", "i4": "MET_INT", "f4": "MET_FLOAT",
             "f8": "MET_DOUBLE"}
    spacing = np.linalg.norm(matrix, axis=0)
    cosines = " ".join(repr(float(c)) for c in (matrix / spacing).flatten(order="F"))
    return "\n".join([
        "ObjectType = Image", "NDims = 3", f"BinaryDataByteOrderMSB = {order == '>'}", f"TransformMatrix = {cosines}",
        "Offset = " + " ".join(map(repr, origin)), "CenterOfRotation = 0 0 0", "AnatomicalOrientation = RAI",
        "ElementSpacing = " + " ".join(repr(float(s)) for s in spacing), "DimSize = " + " ".join(map(str, array.shape)),
        f"ElementType = {names[array.dtype.str[1:]]}", *fields, f"ElementDataFile = {data}\n"])


def metaimage_files(folder):
    # What ITK writes itself, of each geometry.
    for name, dtype, geometry, compressed in [
        ("axial.mha", np.int16, "axial", False),
        ("oblique_zlib.mha", np.uint16, "oblique", True),
        ("flipped.mhd", np.uint8, "flipped", False),
        ("left_handed_zlib.mhd", np.float32, "left_handed", True),
        ("sagittal.mha", np.int32, "sagittal", False),
        ("coronal.mha", np.float64, "coronal", True),
    ]:
        image = sitk.GetImageFromArray(samples(name, dtype).transpose(2, 1, 0))
        matrix = GEOMETRIES[geometry]
        spacing = np.linalg.norm(matrix, axis=0)
        image.SetSpacing(spacing.tolist())
        image.SetDirection((matrix / spacing).flatten().tolist())
        image.SetOrigin(ORIGIN)
        sitk.WriteImage(image, str(folder / name), compressed)
        yield name

    matrix = GEOMETRIES["oblique"]
    name = "be_i16.mha"
    array = samples(name, "i2")
    text = metaimage_header(array, ">", matrix, ORIGIN, ["BinaryData = True"], "LOCAL")
    (folder / name).write_bytes(text.encode() + payload(array, ">", "raw"))
    yield name

    name = "text.mha"
    array = samples(name, "f4")
    text = metaimage_header(array, "<", matrix, ORIGIN, ["BinaryData = False"], "LOCAL")
    (folder / name).write_bytes(text.encode() + payload(array, "<", "ascii"))
    yield name

    name = "header_before.mhd"
    array = samples(name, "i2")
    (folder / name).write_text(metaimage_header(array, ">", matrix, ORIGIN, ["HeaderSize = -1"], "header_before.bin"))
    (folder / "header_before.bin").write_bytes(b"a header of its own\n" + payload(array, ">", "raw"))
    yield name

    for name, data in [("listed.mhd", "LIST\n" + "\n".join(f"slices/s{i}.raw" for i in range(DIMS[2]))),
                       ("numbered.mhd", "slices/n%02d.raw 1 9 2")]:
        array = samples(name, "u2")
        (folder / name).write_text(metaimage_header(array, "<", matrix, ORIGIN, [], data))
        (folder / "slices").mkdir(exist_ok=True)
        for i in range(DIMS[2]):
            file = f"s{i}.raw" if name[0] == "l" else f"n{1 + 2 * i:02d}.raw"
            (folder / "slices" / file).write_bytes(payload(array[:, :, i : i + 1], "<", "raw"))
        yield name


def text(number):
    return repr(float(number))


def described(label, values, position):
    """`values` x, y, z in float64; `position` takes an index to LPS millimetres."""
    random = np.random.default_rng(7)
    corners = [tuple((n - 1) * bit for n, bit in zip(values.shape, bits)) for bits in np.ndindex(2, 2, 2)]
    inside = [tuple(int(random.integers(n)) for n in values.shape) for _ in range(VOXELS_A_FILE - len(corners))]
    return {
        "file": label,
        "dims": list(values.shape),
        "minimum": text(values.min()),
        "maximum": text(values.max()),
        "mean": text(values.mean()),
        "voxels": [
            {"index": [int(i) for i in at], "lps_mm": [text(c) for c in position(at)], "value": text(values[at])}
            for at in corners + inside
        ],
    }


def golden(path, label):
    image = sitk.ReadImage(str(path))
    values = sitk.GetArrayFromImage(image).transpose(2, 1, 0).astype(np.float64)
    if path.suffix in (".nrrd", ".nhdr") and path.stem not in ("listed", "numbered"):
        # Two readers must agree. (pynrrd stumbles over a list and over numbers that go down.)
        assert np.array_equal(nrrd.read(str(path))[0].astype(np.float64), values), path
    return described(label, values, lambda at: image.TransformIndexToPhysicalPoint([int(i) for i in at]))


def main():
    data = pathlib.Path(sys.argv[1])
    small = []
    for kind, files in [("nrrd", nrrd_files), ("metaimage", metaimage_files)]:
        (FIXTURES / kind).mkdir(parents=True, exist_ok=True)
        small += [golden(FIXTURES / kind / name, f"{kind}/{name}") for name in files(FIXTURES / kind)]
    found = [p for kind in ("nrrd", "nhdr", "mha", "mhd") for p in sorted(data.glob(f"*/*.{kind}"))]
    shared = [golden(path, str(path.relative_to(data))) for path in found]
    out = json.dumps({"small": small, "shared": shared}, indent=None, separators=(",", ":"))
    (FIXTURES / "volumes.json").write_text(out.replace('{"file"', '\n{"file"') + "\n")
    print(f"{len(small)} small files, {len(shared)} files of {data}")


if __name__ == "__main__":
    main()

#!/usr/bin/env python3
"""Golden values for the tests of crates/volume-io, computed with nibabel and not with our code.

    python3 -m venv venv && venv/bin/pip install nibabel numpy
    venv/bin/python tools/golden_geometry.py ../shared/data

Writes crates/volume-io/tests/fixtures/nifti/*.nii[.gz], small files of each type, byte order, version and transform,
and crates/volume-io/tests/fixtures/golden.json: for these and for the NIfTI files of the data folder the dimensions,
the patient positions (LPS, mm) of some voxels, the values there (slope and intercept in float64), and minimum, maximum
and mean. Numbers are text, so that every digit of a float64 survives.
"""

import gzip
import json
import pathlib
import sys

import nibabel as nib
import numpy as np

ROOT = pathlib.Path(__file__).resolve().parent.parent
FIXTURES = ROOT / "crates/volume-io/tests/fixtures"
VOXELS_A_FILE = 40
LPS_FROM_RAS = np.diag([-1.0, -1.0, 1.0, 1.0])


def rotation(axis, degrees):
    axis = np.asarray(axis, float) / np.linalg.norm(axis)
    k = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
    t = np.radians(degrees)
    return np.eye(3) + np.sin(t) * k + (1 - np.cos(t)) * (k @ k)


def affine(matrix, origin):
    full = np.eye(4)
    full[:3, :3] = matrix
    full[:3, 3] = origin
    return full


def small_files():
    """Name, class, byte order, type, affine, which transforms are set, slope and intercept, time steps."""
    spacing = np.diag([0.7, 0.8, 2.5])
    plain = affine(spacing, [-30.5, 12.25, 7])
    flipped = affine(np.diag([-0.7, 0.8, 2.5]), [30.5, 12.25, 7])
    three = affine(np.diag([-1.0, -0.5, -4.0]), [1, 2, 3])
    oblique = affine(rotation([1, 2, 3], 25) @ spacing, [-30.5, 12.25, 7])
    half_turn = affine(rotation([0, 0, 1], 180) @ spacing, [5, 6, 7])
    sagittal = affine(np.array([[0, 0, 1.2], [0.9, 0, 0], [0, 0.9, 0]]), [-80, -90, -100])
    coronal = affine(np.array([[1.1, 0, 0], [0, 0, -3], [0, 1.1, 0]]), [-80, 90, -100])
    sheared = affine(np.array([[0.5, 0, 0], [0, 0.5, 1.2], [0, 0, 2.4]]), [-10, -20, -30])
    one, two = nib.Nifti1Image, nib.Nifti2Image
    return [
        ("n1_le_u8_sform.nii", one, "<", "u1", plain, "s", None, 1),
        ("n1_be_i16_sform_scaled.nii", one, ">", "i2", plain, "s", (2.5, -1024.0), 1),
        ("n1_le_i16_negative_slope.nii", one, "<", "i2", plain, "s", (-0.1, 3.0), 1),
        ("n1_le_u16_qform_flipped.nii", one, "<", "u2", flipped, "q", None, 1),
        ("n1_le_f32_three_negative_axes.nii", one, "<", "f4", three, "s", None, 1),
        ("n1_be_f32_qform_oblique.nii.gz", one, ">", "f4", oblique, "q", None, 1),
        ("n1_le_u8_qform_half_turn.nii", one, "<", "u1", half_turn, "q", None, 1),
        ("n1_le_u8_qform_and_other_sform.nii", one, "<", "u1", oblique, "q+s", None, 1),
        ("n1_le_i32_sagittal.nii", one, "<", "i4", sagittal, "s", None, 1),
        ("n1_be_u32_coronal.nii.gz", one, ">", "u4", coronal, "s", (0.25, 1.0), 1),
        ("n1_le_i8_series.nii", one, "<", "i1", plain, "s", None, 3),
        ("n1_le_f64_sheared.nii", one, "<", "f8", sheared, "s", None, 1),
        ("n2_le_f32_sheared.nii", two, "<", "f4", sheared, "s", None, 1),
        ("n2_be_i16_qform_oblique.nii.gz", two, ">", "i2", oblique, "q", (3.0, 0.125), 1),
        ("n2_le_u16_sform.nii.gz", two, "<", "u2", plain, "s", None, 1),
        ("n2_be_i64_flipped.nii", two, ">", "i8", flipped, "s", None, 1),
        ("n2_le_u64_sform.nii", two, "<", "u8", plain, "s", None, 1),
        ("n1_le_u8_neither.nii", one, "<", "u1", np.diag([0.7, 0.8, 2.5, 1]), "", None, 1),
    ]


def write_small(name, kind, order, dtype, transform, which, scaling, steps):
    random = np.random.default_rng(sum(name.encode()))
    shape = (4, 3, 5) if steps == 1 else (4, 3, 5, steps)
    info = np.iinfo(dtype) if dtype[0] in "iu" else None
    low, high = (max(info.min, -2000), min(info.max, 3000)) if info else (-2000, 3000)
    stored = random.integers(low, high, shape, endpoint=True)
    if not info:
        stored = stored / 8  # float64 that float32 holds exactly
    header = kind.header_class(endianness=order)
    header.set_data_dtype(np.dtype(dtype).newbyteorder(order))
    image = kind(stored.astype(dtype), transform, header)
    image.set_sform(transform if "s" in which else None, 2 if "s" in which else 0)
    image.set_qform(transform if "q" in which else None, 1 if "q" in which else 0)
    if which == "q+s":
        image.set_sform(affine(np.diag([9.0, 8.0, 7.0]), [1, 1, 1]), 2)
    header = image.header
    header["pixdim"][1:4] = np.linalg.norm(transform[:3, :3], axis=0)
    header["scl_slope"], header["scl_inter"] = scaling or (0, 0)
    # What nibabel would write, but with the stored numbers as they are.
    header["magic"] = b"n+1" if kind is nib.Nifti1Image else header["magic"]
    header["vox_offset"] = 352 if kind is nib.Nifti1Image else 544
    content = header.binaryblock + bytes(4) + stored.astype(np.dtype(dtype).newbyteorder(order)).tobytes(order="F")
    path = FIXTURES / "nifti" / name
    path.write_bytes(gzip.compress(content, 9, mtime=0) if name.endswith(".gz") else content)
    return path


def golden(path, label):
    image = nib.load(path)
    raw = np.asanyarray(image.dataobj.get_unscaled())
    while raw.ndim > 3:
        raw = raw[..., 0]
    slope, intercept = image.dataobj.slope, image.dataobj.inter
    values = raw.astype(np.float64) * np.float64(slope) + np.float64(intercept)
    header = image.header
    if header["sform_code"] <= 0 and header["qform_code"] <= 0:
        # Method 1 of the standard: spacing alone. (nibabel would flip x and centre the volume, as SPM did.)
        transform = np.diag([*header["pixdim"][1:4].astype(float), 1.0])
    else:
        transform = image.affine
    transform = LPS_FROM_RAS @ transform
    random = np.random.default_rng(7)
    corners = [tuple((n - 1) * bit for n, bit in zip(raw.shape, bits)) for bits in np.ndindex(2, 2, 2)]
    inside = [tuple(int(random.integers(n)) for n in raw.shape) for _ in range(VOXELS_A_FILE - len(corners))]
    return {
        "file": label,
        "dims": list(raw.shape),
        "minimum": repr(float(values.min())),
        "maximum": repr(float(values.max())),
        "mean": repr(float(values.mean())),
        "voxels": [
            {
                "index": [int(i) for i in at],
                "lps_mm": [repr(float(c)) for c in (transform @ [*at, 1.0])[:3]],
                "value": repr(float(values[at])),
            }
            for at in corners + inside
        ],
    }


def main():
    data = pathlib.Path(sys.argv[1])
    (FIXTURES / "nifti").mkdir(parents=True, exist_ok=True)
    small = [golden(write_small(*file), file[0]) for file in small_files()]
    shared = [golden(path, str(path.relative_to(data))) for path in sorted(data.glob("**/*.nii.gz"))]
    text = json.dumps({"small": small, "shared": shared}, indent=None, separators=(",", ":"))
    (FIXTURES / "golden.json").write_text(text.replace('{"file"', '\n{"file"') + "\n")
    print(f"{len(small)} small files, {len(shared)} files of {data}")


if __name__ == "__main__":
    main()

#!/usr/bin/env python3
"""Golden values for the tests of crates/volume-io, computed with SimpleITK, pynrrd and pydicom, and not with our code.

    tools/golden_volumes.py ../shared/data

makes a virtual environment in .venv with what it needs, and writes into crates/volume-io/tests/fixtures:
nrrd/, metaimage/ and dicom/, small files of each kind of header and geometry, and volumes.json: for these and for the files of
the data folder the dimensions, the patient positions (LPS, mm) of some voxels, the values there (float64), and minimum,
maximum and mean. Numbers are text, so that every digit of a float64 survives. (NIfTI: tools/golden_geometry.py.)
"""

import gzip
import io
import json
import os
import pathlib
import subprocess
import sys
import venv
import zipfile

ROOT = pathlib.Path(__file__).resolve().parent.parent
VENV = ROOT / ".venv"
NEEDED = ["numpy==2.4.6", "SimpleITK==2.5.7", "pynrrd==1.1.3", "nibabel==5.4.2", "pydicom==3.0.2",
          "pylibjpeg==2.1.0", "pylibjpeg-libjpeg==2.5.0", "pylibjpeg-openjpeg==2.6.0", "pylibjpeg-rle==2.2.0",
          "python-gdcm==3.2.6", "imagecodecs==2026.3.6"]
if pathlib.Path(sys.prefix) != VENV:
    if not (VENV / "bin/python").exists():
        venv.create(VENV, with_pip=True)
    subprocess.run([VENV / "bin/python", "-m", "pip", "install", "--quiet", *NEEDED], check=True)
    os.execv(VENV / "bin/python", [VENV / "bin/python", __file__, *sys.argv[1:]])

import imagecodecs
import nrrd
import numpy as np
import pydicom
import SimpleITK as sitk
from pydicom.dataset import Dataset, FileDataset, FileMetaDataset
from pydicom.encaps import encapsulate
from pydicom.sequence import Sequence

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


# --- DICOM -----------------------------------------------------------------------------------------------------------

IMPLICIT, EXPLICIT, DEFLATED, BIG = ("1.2.840.10008.1.2" + end for end in ("", ".1", ".1.99", ".2"))
RLE, JPEG, JPEG57, JPEG70, JPEG_LS, JPEG_LS_NEAR, J2K, HTJ2K = (
    "1.2.840.10008.1.2" + end for end in (".5", ".4.50", ".4.57", ".4.70", ".4.80", ".4.81", ".4.90", ".4.201"))
STORAGE = {"CT": "1.2.840.10008.5.1.4.1.1.2", "MR": "1.2.840.10008.5.1.4.1.1.4", "PT": "1.2.840.10008.5.1.4.1.1.128",
           "SR": "1.2.840.10008.5.1.4.1.1.88.11"}
SERIES = "1.2.826.0.1.3680043.8.498.1"


def header(modality, uid, syntax, instance):
    meta = FileMetaDataset()
    meta.MediaStorageSOPClassUID = STORAGE[modality]
    meta.MediaStorageSOPInstanceUID = f"{uid}.{instance}"
    meta.TransferSyntaxUID = syntax
    meta.ImplementationClassUID = "1.2.826.0.1.3680043.8.498"
    meta.FileMetaInformationVersion = b"\0\1"
    data = FileDataset("", {}, file_meta=meta, preamble=bytes(128), is_implicit_VR=syntax == IMPLICIT, is_little_endian=syntax != BIG)
    data.SOPClassUID, data.SOPInstanceUID = meta.MediaStorageSOPClassUID, meta.MediaStorageSOPInstanceUID
    data.Modality = modality
    data.PatientName, data.PatientID, data.PatientBirthDate = "Nobody^Test", "NOBODY-1", "19000101"
    data.StudyInstanceUID, data.SeriesInstanceUID = SERIES, uid
    data.SeriesNumber, data.InstanceNumber = int(uid.split(".")[-1]), instance
    return data


def describe_pixels(data, array, stored_bits):
    data.SamplesPerPixel, data.PhotometricInterpretation = 1, "MONOCHROME2"
    data.Rows, data.Columns = array.shape[-2:]
    data.BitsAllocated = array.dtype.itemsize * 8
    data.BitsStored, data.HighBit = stored_bits, stored_bits - 1
    data.PixelRepresentation = int(array.dtype.kind == "i")


def encoded(array, syntax, stored_bits):
    """One frame in a compressed transfer syntax, by an encoder that has nothing to do with our decoders."""
    if syntax == RLE:
        planes = array.astype("<" + array.dtype.str[1:]).reshape(-1).view(np.uint8).reshape(-1, array.itemsize)
        segments = []
        for byte in range(array.itemsize - 1, -1, -1):
            segments.append(packed(planes[:, byte].tobytes(), array.shape[1]))
        offsets = np.zeros(16, "<u4")
        offsets[0] = len(segments)
        at = 64
        for i, segment in enumerate(segments):
            offsets[1 + i] = at
            at += len(segment)
        return offsets.tobytes() + b"".join(segments)
    unsigned = array.view(f"u{array.itemsize}")
    unsigned = unsigned & unsigned.dtype.type((1 << stored_bits) - 1)
    if syntax == JPEG:
        return imagecodecs.jpeg8_encode(unsigned, level=95)
    if syntax in (JPEG57, JPEG70):
        return imagecodecs.ljpeg_encode(unsigned, bitspersample=stored_bits)
    if syntax in (JPEG_LS, JPEG_LS_NEAR):
        return imagecodecs.jpegls_encode(unsigned, level=2 if syntax == JPEG_LS_NEAR else 0)
    if syntax == J2K:
        return imagecodecs.jpeg2k_encode(array, codecformat="j2k", level=0, reversible=True)
    return imagecodecs.htj2k_encode(array, reversible=True)


def packed(row_bytes, width):
    """PackBits: each row on its own, as the standard wants."""
    out = bytearray()
    for start in range(0, len(row_bytes), width):
        row = row_bytes[start : start + width]
        at = 0
        while at < len(row):
            same = 1
            while at + same < len(row) and same < 128 and row[at + same] == row[at]:
                same += 1
            if same > 1:
                out += bytes([257 - same, row[at]])
                at += same
            else:
                end = at + 1
                while end < len(row) and end - at < 128 and (end + 1 >= len(row) or row[end] != row[end + 1]):
                    end += 1
                out += bytes([end - at - 1]) + row[at:end]
                at = end
    return bytes(out) + b"\0" * (len(out) % 2)


def decoded(data, array, syntax):
    """What a lossy frame means: what another decoder makes of it."""
    frame = bytes(data)
    if syntax == JPEG:
        return imagecodecs.jpeg8_decode(frame)
    if syntax == JPEG_LS_NEAR:
        return imagecodecs.jpegls_decode(frame).view(array.dtype)
    return array


def picture(name, index, dtype, stored_bits, shape):
    """Smooth ramps with noise, so that codecs have something to predict, with the extremes of the type in it."""
    random = np.random.default_rng(sum(name.encode()) + index)
    signed = np.dtype(dtype).kind == "i"
    low, high = (-(1 << (stored_bits - 1)), (1 << (stored_bits - 1)) - 1) if signed else (0, (1 << stored_bits) - 1)
    y, x = np.mgrid[: shape[0], : shape[1]]
    values = (low + high) / 2 + (high - low) / 3 * np.sin(x / 5 + index) * np.cos(y / 4)
    values = values + random.normal(0, (high - low) / 200, shape)
    values[2:5, 3:9] = values[2, 3]
    values[0, 0], values[0, 1] = low, high
    return np.clip(np.rint(values), low, high).astype(dtype)


def save(data, path, frames, syntax, stored_bits):
    """Writes frames; gives back what they mean."""
    describe_pixels(data, frames[0], stored_bits)
    if len(frames) > 1:
        data.NumberOfFrames = len(frames)
    if syntax in (IMPLICIT, EXPLICIT, DEFLATED, BIG):
        order = ">" if syntax == BIG else "<"
        raw = b"".join(f.astype(order + f.dtype.str[1:]).tobytes() for f in frames)
        data.PixelData = raw + b"\0" * (len(raw) % 2)
        data["PixelData"].VR = "OW" if frames[0].itemsize > 1 else "OB"
        meant = frames
    else:
        pieces = [bytes(encoded(f, syntax, stored_bits)) for f in frames]
        meant = [decoded(p, f, syntax) for p, f in zip(pieces, frames)]
        data.PixelData = encapsulate([p + b"\0" * (len(p) % 2) for p in pieces])
        data["PixelData"].VR = "OB"
        data["PixelData"].is_undefined_length = True
    path.parent.mkdir(parents=True, exist_ok=True)
    data.save_as(path, enforce_file_format=True)
    return meant


def series(folder, name, syntax=EXPLICIT, dtype="i2", stored_bits=16, geometry="axial", shape=(12, 14), count=4, modality="CT",
           scale=lambda i: (1.0, -1024.0), steps=None, change=lambda data, i: None, uid=SERIES + ".7"):
    """A folder of slices whose names are not in their order. The golden values are made from what went in."""
    matrix = GEOMETRIES[geometry]
    spacing = np.linalg.norm(matrix, axis=0)
    row, column = matrix[:, 0] / spacing[0], matrix[:, 1] / spacing[1]
    normal = np.cross(row, column)
    steps = steps or [i * spacing[2] * normal for i in range(count)]
    slices = []
    for i, step in enumerate(steps):
        data = header(modality, uid, syntax, i + 1)
        data.ImageOrientationPatient = [float(f"{c:.10g}") for c in [*row, *column]]
        data.ImagePositionPatient = [float(f"{c:.10g}") for c in np.array(ORIGIN) + step]
        data.PixelSpacing = [float(f"{spacing[1]:.10g}"), float(f"{spacing[0]:.10g}")]
        data.SliceThickness = float(f"{spacing[2]:.10g}")
        slope, intercept = scale(i)
        data.RescaleSlope, data.RescaleIntercept = slope, intercept
        data.WindowCenter, data.WindowWidth = 40, 400
        change(data, i)
        meant = save(data, folder / name / f"{(7 * i + 3) % len(steps)}{i}.dcm", [picture(name, i, dtype, stored_bits, shape)],
                     syntax, stored_bits)
        slices.append((np.array(data.ImagePositionPatient, float), meant[0] * np.float64(slope) + np.float64(intercept)))
    geometry = np.array(data.ImageOrientationPatient, float), np.array(data.PixelSpacing, float)
    golden = stack(f"dicom/{name}", slices, *geometry)
    if syntax == JPEG:
        # ITU-T T.83 lets decoders of lossy JPEG differ by one.
        golden["within"] = text(1)
    return golden


def stack(label, slices, orientation, pixel_spacing, anywhere=False):
    """Golden values of slices (position, values by row and column), put in order along their normal."""
    row, column = orientation[:3], orientation[3:]
    normal = np.cross(row, column)
    slices = sorted(slices, key=lambda s: float(np.dot(s[0], normal)))
    values = np.stack([v for _, v in slices]).transpose(2, 1, 0)

    def position(at):
        return slices[at[2]][0] + at[0] * pixel_spacing[1] * row + at[1] * pixel_spacing[0] * column

    golden = described(label, values, position)
    if anywhere:
        golden["anywhere"] = True
    return golden


def enhanced(folder, name, syntax):
    """An enhanced MR image: the frames' positions and scales in functional groups, not in their order."""
    shape, count, bits = (10, 12), 5, 12
    matrix = GEOMETRIES["oblique"]
    spacing = np.linalg.norm(matrix, axis=0)
    cosines = matrix / spacing
    data = header("MR", SERIES + ".9", syntax, 1)
    shared, measures, plane, transformation = Dataset(), Dataset(), Dataset(), Dataset()
    measures.PixelSpacing = [float(f"{spacing[1]:.10g}"), float(f"{spacing[0]:.10g}")]
    measures.SliceThickness = float(f"{spacing[2]:.10g}")
    plane.ImageOrientationPatient = [float(f"{c:.10g}") for c in [*cosines[:, 0], *cosines[:, 1]]]
    transformation.RescaleSlope, transformation.RescaleIntercept, transformation.RescaleType = 0.5, 3, "US"
    shared.PixelMeasuresSequence = Sequence([measures])
    shared.PlaneOrientationSequence = Sequence([plane])
    shared.PixelValueTransformationSequence = Sequence([transformation])
    data.SharedFunctionalGroupsSequence = Sequence([shared])
    groups, frames, positions = [], [], []
    for i in [2, 0, 4, 1, 3]:
        group, place = Dataset(), Dataset()
        at = np.array(ORIGIN) + i * matrix[:, 2]
        place.ImagePositionPatient = [float(f"{c:.10g}") for c in at]
        group.PlanePositionSequence = Sequence([place])
        groups.append(group)
        positions.append(np.array(place.ImagePositionPatient, float))
        frames.append(picture(name, i, "u2", bits, shape))
    data.PerFrameFunctionalGroupsSequence = Sequence(groups)
    (folder / name).mkdir(exist_ok=True)
    meant = save(data, folder / name / "all.dcm", frames, syntax, bits)
    slices = [(at, m * 0.5 + 3.0) for at, m in zip(positions, meant)]
    orientation = np.array(plane.ImageOrientationPatient, float)
    return stack(f"dicom/{name}/all.dcm", slices, orientation, np.array(measures.PixelSpacing, float))


def pet(data, i):
    data.Units, data.DecayCorrection = "BQML", "START"
    data.CorrectedImage = ["ATTN", "DECY", "SCAT"]
    data.SeriesDate = data.AcquisitionDate = "20240301"
    data.SeriesTime, data.AcquisitionTime = "101500", f"10{15 + i}00.5"
    data.PatientWeight = 72.5
    injected = Dataset()
    injected.RadiopharmaceuticalStartTime, injected.RadionuclideTotalDose, injected.RadionuclideHalfLife = "091230", 3.7e8, 6586.2
    data.RadiopharmaceuticalInformationSequence = Sequence([injected])


SUV = 72500 / (3.7e8 * 2 ** (-(62.5 * 60) / 6586.2))


def dicom_files(folder):
    yield series(folder, "explicit_axial")
    yield series(folder, "implicit_sagittal", IMPLICIT, "u2", 12, "sagittal")
    yield series(folder, "big_endian_coronal", BIG, "i2", 12, "coronal")
    yield series(folder, "deflated_oblique", DEFLATED, "u2", 16, "oblique", scale=lambda i: (0.25, 5.5))
    yield series(folder, "flipped_u8", EXPLICIT, "u1", 8, "flipped", modality="MR")
    yield series(folder, "rle_signed", RLE, "i2", 16, "oblique")
    yield series(folder, "rle_u8", RLE, "u1", 8)
    yield series(folder, "jpeg_u8", JPEG, "u1", 8, shape=(16, 24))
    yield series(folder, "jpeg57_u16", JPEG57, "u2", 16)
    yield series(folder, "jpeg70_i12", JPEG70, "i2", 12)
    yield series(folder, "jpeg_ls_u16", JPEG_LS, "u2", 16, shape=(40, 33))
    yield series(folder, "jpeg_ls_i12", JPEG_LS, "i2", 12, shape=(33, 40))
    yield series(folder, "jpeg_ls_u8", JPEG_LS, "u1", 8, shape=(30, 31))
    yield series(folder, "jpeg_ls_near", JPEG_LS_NEAR, "u2", 12, shape=(40, 33))
    yield series(folder, "jpeg_2000_i16", J2K, "i2", 16, shape=(40, 33))
    yield series(folder, "jpeg_2000_u16", J2K, "u2", 16, shape=(33, 40))
    yield series(folder, "jpeg_2000_u8", J2K, "u1", 8, shape=(33, 40))
    yield series(folder, "htj2k_u16", HTJ2K, "u2", 16, shape=(40, 33))
    yield series(folder, "htj2k_i16", HTJ2K, "i2", 16, shape=(40, 33))
    yield series(folder, "scale_of_each_slice", dtype="u2", modality="PT", scale=lambda i: (0.5 + i / 4, 2.0))
    yield series(folder, "suv", dtype="u2", modality="PT", scale=lambda i: (1.5, 0.0), change=pet)
    tilted = [np.array([0, i * 5 * np.sin(np.radians(18.5)) / np.cos(np.radians(18.5)), i * 5.0]) for i in range(5)]
    yield series(folder, "tilted", steps=tilted)
    yield enhanced(folder, "enhanced", EXPLICIT)
    yield enhanced(folder, "enhanced_jpeg_ls", JPEG_LS)


def dicom_shared(data):
    """Series of the data folder: by pydicom, as they are in the archives."""
    for name in ["lidc0314_ct_20slices", "ge_head_ct_tilt_uneven", "mr_oblique_shoulder", "mr_sagittal_oblique_missing_slice"]:
        archive = zipfile.ZipFile(data / "dicom" / f"{name}.zip")
        slices = []
        for entry in sorted(archive.namelist()):
            if entry.endswith(".dcm"):
                d = pydicom.dcmread(io.BytesIO(archive.read(entry)))
                values = d.pixel_array * np.float64(d.get("RescaleSlope", 1)) + np.float64(d.get("RescaleIntercept", 0))
                slices.append((np.array(d.ImagePositionPatient, float), values))
        geometry = np.array(d.ImageOrientationPatient, float), np.array(d.PixelSpacing, float)
        yield stack(f"dicom/{name}.zip", slices, *geometry, anywhere="uneven" in name or "missing" in name)
    d = pydicom.dcmread(io.BytesIO(zipfile.ZipFile(data / "dicom/mr_enhanced_multiframe.zip").read("enhanced_12.dcm")))
    slices = []
    for frame, values in zip(d.PerFrameFunctionalGroupsSequence, d.pixel_array):
        scale = frame.PixelValueTransformationSequence[0]
        values = values * np.float64(scale.RescaleSlope) + np.float64(scale.RescaleIntercept)
        slices.append((np.array(frame.PlanePositionSequence[0].ImagePositionPatient, float), values))
    geometry = frame.PlaneOrientationSequence[0].ImageOrientationPatient, frame.PixelMeasuresSequence[0].PixelSpacing
    yield stack("dicom/mr_enhanced_multiframe.zip", slices, *(np.array(g, float) for g in geometry))
    archive = zipfile.ZipFile(data / "dicom/ct_slice_15_syntaxes.zip")
    for entry in sorted(archive.namelist()):
        if not entry.endswith(".dcm"):
            continue
        d = pydicom.dcmread(io.BytesIO(archive.read(entry)))
        try:
            values = d.pixel_array * np.float64(d.RescaleSlope) + np.float64(d.RescaleIntercept)
        except Exception:
            continue
        geometry = np.array(d.ImageOrientationPatient, float), np.array(d.PixelSpacing, float)
        golden = stack(f"dicom/ct_slice_15_syntaxes.zip/{entry}", [(np.array(d.ImagePositionPatient, float), values)], *geometry)
        syntax = str(d.file_meta.TransferSyntaxUID)
        # Decoders of lossy JPEG may differ by one stored number (ITU-T T.83); those of lossy JPEG 2000 in where in a
        # quantiser's interval they put a value back (ITU-T T.800, E.1): by two here, where the coding itself lost five.
        lossy = {"1.2.840.10008.1.2.4.50": float(d.RescaleSlope), "1.2.840.10008.1.2.4.91": 2}
        if syntax in lossy:
            golden["within"] = text(lossy[syntax])
        yield {**golden, "syntax": syntax}


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
    dicom = list(dicom_files(FIXTURES / "dicom"))
    for golden_suv in (g for g in dicom if g["file"] == "dicom/suv"):
        golden_suv["factor"] = text(SUV)
    found = [p for kind in ("nrrd", "nhdr", "mha", "mhd") for p in sorted(data.glob(f"*/*.{kind}"))]
    shared = [golden(path, str(path.relative_to(data))) for path in found]
    archives = list(dicom_shared(data))
    out = json.dumps({"small": small, "shared": shared, "dicom": dicom, "archives": archives}, indent=None, separators=(",", ":"))
    (FIXTURES / "volumes.json").write_text(out.replace('{"file"', '\n{"file"') + "\n")
    print(f"{len(small)} small files, {len(dicom)} DICOM series; of {data}: {len(shared)} files, {len(archives)} DICOM series")


if __name__ == "__main__":
    main()

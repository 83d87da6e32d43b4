//! The elements that are read, by their names in DICOM PS3.6. Everything else in a file is passed over.

use dicom_core::Tag;

macro_rules! tags {
    ($($name:ident = ($group:literal, $element:literal);)*) => {
        $(pub(super) const $name: Tag = Tag($group, $element);)*
        /// All of them but the pixels.
        pub(super) const READ: &[Tag] = &[$($name),*];
    };
}

tags! {
    IMAGE_TYPE = (0x0008, 0x0008);
    SERIES_DATE = (0x0008, 0x0021);
    ACQUISITION_DATE = (0x0008, 0x0022);
    SERIES_TIME = (0x0008, 0x0031);
    ACQUISITION_TIME = (0x0008, 0x0032);
    MODALITY = (0x0008, 0x0060);
    PATIENT_NAME = (0x0010, 0x0010);
    PATIENT_ID = (0x0010, 0x0020);
    PATIENT_BIRTH_DATE = (0x0010, 0x0030);
    PATIENT_SEX = (0x0010, 0x0040);
    PATIENT_WEIGHT = (0x0010, 0x1030);
    TRIGGER_TIME = (0x0018, 0x1060);
    SLICE_THICKNESS = (0x0018, 0x0050);
    SPACING_BETWEEN_SLICES = (0x0018, 0x0088);
    RADIOPHARMACEUTICAL_START_TIME = (0x0018, 0x1072);
    RADIONUCLIDE_TOTAL_DOSE = (0x0018, 0x1074);
    RADIONUCLIDE_HALF_LIFE = (0x0018, 0x1075);
    RADIOPHARMACEUTICAL_START_DATE_TIME = (0x0018, 0x1078);
    STUDY_INSTANCE_UID = (0x0020, 0x000d);
    SERIES_INSTANCE_UID = (0x0020, 0x000e);
    SERIES_NUMBER = (0x0020, 0x0011);
    INSTANCE_NUMBER = (0x0020, 0x0013);
    IMAGE_POSITION = (0x0020, 0x0032);
    IMAGE_ORIENTATION = (0x0020, 0x0037);
    TEMPORAL_POSITION = (0x0020, 0x0100);
    TEMPORAL_POSITION_INDEX = (0x0020, 0x9128);
    SAMPLES_PER_PIXEL = (0x0028, 0x0002);
    PHOTOMETRIC = (0x0028, 0x0004);
    FRAMES = (0x0028, 0x0008);
    ROWS = (0x0028, 0x0010);
    COLUMNS = (0x0028, 0x0011);
    PIXEL_SPACING = (0x0028, 0x0030);
    CORRECTED_IMAGE = (0x0028, 0x0051);
    BITS_ALLOCATED = (0x0028, 0x0100);
    BITS_STORED = (0x0028, 0x0101);
    HIGH_BIT = (0x0028, 0x0102);
    PIXEL_REPRESENTATION = (0x0028, 0x0103);
    WINDOW_CENTRE = (0x0028, 0x1050);
    WINDOW_WIDTH = (0x0028, 0x1051);
    RESCALE_INTERCEPT = (0x0028, 0x1052);
    RESCALE_SLOPE = (0x0028, 0x1053);
    UNITS = (0x0054, 0x1001);
    DECAY_CORRECTION = (0x0054, 0x1102);
    FRAME_OFFSETS = (0x3004, 0x000c);
    DOSE_GRID_SCALING = (0x3004, 0x000e);
}

/// The pixels.
pub(super) const PIXEL_DATA: Tag = Tag(0x7fe0, 0x0010);
/// Pixels as float32 and float64.
pub(super) const FLOAT_PIXELS: [Tag; 2] = [Tag(0x7fe0, 0x0008), Tag(0x7fe0, 0x0009)];

/// The sequence of what holds for all frames.
pub(super) const SHARED: Tag = Tag(0x5200, 0x9229);
/// The sequence with an item for each frame.
pub(super) const PER_FRAME: Tag = Tag(0x5200, 0x9230);
/// The sequence of what was injected.
pub(super) const RADIOPHARMACEUTICAL: Tag = Tag(0x0054, 0x0016);

/// The functional groups that are read, with the elements of each.
pub(super) const GROUPS: &[(Tag, &[Tag])] = &[
    (Tag(0x0020, 0x9111), &[TEMPORAL_POSITION_INDEX]),
    (Tag(0x0020, 0x9113), &[IMAGE_POSITION]),
    (Tag(0x0020, 0x9116), &[IMAGE_ORIENTATION]),
    (Tag(0x0028, 0x9110), &[PIXEL_SPACING, SLICE_THICKNESS, SPACING_BETWEEN_SLICES]),
    (Tag(0x0028, 0x9132), &[WINDOW_CENTRE, WINDOW_WIDTH]),
    (Tag(0x0028, 0x9145), &[RESCALE_INTERCEPT, RESCALE_SLOPE]),
];

//! Transfer syntaxes: how a data set and its pixels are written.

use crate::LoadError;
use crate::samples::ByteOrder;
use crate::text::short;
use dicom_transfer_syntax_registry::entries;

/// How the UIDs of all transfer syntaxes of the standard begin.
const ROOT: &str = "1.2.840.10008.1.2";

/// How pixels are compressed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Codec {
    Rle,
    /// JPEG of ITU-T T.81: baseline, extended, progressive and lossless.
    Jpeg,
    JpegLs,
    /// JPEG 2000 and its high-throughput variant.
    Jpeg2000,
}

/// A transfer syntax that is read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Syntax {
    ImplicitLittle,
    ExplicitLittle,
    ExplicitBig,
    Deflated,
    Encapsulated(Codec),
    /// Its pixels are not read here; what the file says can be.
    Unread,
}

impl Syntax {
    /// The syntax of that UID (DICOM PS3.5, section 10 and annex A).
    pub(super) fn named(uid: &str) -> Self {
        match uid.strip_prefix(ROOT) {
            Some("") => Self::ImplicitLittle,
            Some(".1") => Self::ExplicitLittle,
            Some(".1.99") => Self::Deflated,
            Some(".2") => Self::ExplicitBig,
            Some(".5") => Self::Encapsulated(Codec::Rle),
            Some(".4.50" | ".4.51" | ".4.53" | ".4.55" | ".4.57" | ".4.70") => {
                Self::Encapsulated(Codec::Jpeg)
            }
            Some(".4.80" | ".4.81") => Self::Encapsulated(Codec::JpegLs),
            Some(".4.90" | ".4.91" | ".4.201" | ".4.202" | ".4.203") => Self::Encapsulated(Codec::Jpeg2000),
            _ => Self::Unread,
        }
    }

    /// Order of the bytes of numbers in the data set.
    pub(super) fn order(self) -> ByteOrder {
        if self == Self::ExplicitBig { ByteOrder::Big } else { ByteOrder::Little }
    }

    pub(super) fn is_deflated(self) -> bool {
        self == Self::Deflated
    }

    pub(super) fn is_encapsulated(self) -> bool {
        matches!(self, Self::Encapsulated(_) | Self::Unread)
    }

    /// How the data set is written, unpacked, for dicom-rs.
    pub(super) fn data_set(self) -> dicom_transfer_syntax_registry::TransferSyntax {
        match self {
            Self::ImplicitLittle => entries::IMPLICIT_VR_LITTLE_ENDIAN.erased(),
            Self::ExplicitBig => entries::EXPLICIT_VR_BIG_ENDIAN.erased(),
            _ => entries::EXPLICIT_VR_LITTLE_ENDIAN.erased(),
        }
    }
}

/// Why the pixels of a file are not read.
pub(super) fn unread(file: &str, uid: &str) -> LoadError {
    let what = match uid.strip_prefix(ROOT) {
        Some(".4.92" | ".4.93") => "JPEG 2000 part 2",
        Some(".4.110" | ".4.111" | ".4.112") => "JPEG XL",
        Some(".8.1") => "deflated frames",
        Some(number) if number.starts_with(".4.10") => "video",
        Some(_) => "not known here",
        None => "no transfer syntax of the standard",
    };
    let expected = "uncompressed, deflated, RLE, JPEG, JPEG-LS, JPEG 2000 or HTJ2K";
    LoadError::field(file, "transfer syntax", expected, &format!("{} ({what})", short(uid)))
}

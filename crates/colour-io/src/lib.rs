//! Colours from files of other programs: transfer functions, colour maps, tables of labels.
//!
//! [`load_transfer`] reads volume properties and `presets.xml` of 3D Slicer and colour maps of ParaView (JSON, XML);
//! [`load_labels`] reads colour tables of 3D Slicer and ITK-SNAP and tables in JSON. What a file is, its content decides.
//! What a file says that a scene cannot show is told in notes; what is wrong in it is an error that names the file, what was
//! expected and what was found.
//!
//! This crate knows no volume, no GPU and no network.

mod error;
mod knots;
mod labels;
mod paraview;
mod slicer;
mod transfer;

pub use error::ColourError;
pub use labels::{labels, load_labels};
pub use transfer::{Imported, Values, load_transfer, transfer};

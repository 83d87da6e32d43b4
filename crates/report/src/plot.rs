//! Pictures of figures. A picture is laid out as a list of shapes, which is data; two small backends write that list as
//! SVG or paint it as PNG.

mod axis;
mod canvas;
mod chart;
mod column;
mod font;
mod latency;
mod legend;
mod palette;
mod pareto;
mod raster;
mod sheet;
mod svg;

pub use axis::Scale;
pub use canvas::Picture;
pub use chart::{Axis, Plot, Point};
pub use latency::{latency, latency_of};
pub use pareto::pareto_front;
pub use sheet::{Sheet, Tile};

//! How alike two pictures are, as the encoder sees them: planes of BT.709, limited range, 4:2:0.

use codec::YuvPicture;
use std::fmt;
use std::path::PathBuf;

/// A picture of both eyes side by side as three planes, before it is rounded to bytes.
#[derive(Clone, Debug, PartialEq)]
pub struct Planes {
    size_px: [usize; 2],
    /// Luma, 16 to 235.
    y: Vec<f64>,
    /// Blue difference, 16 to 240, half as many across and down.
    u: Vec<f64>,
    /// Red difference.
    v: Vec<f64>,
}

/// Peak signal-to-noise ratios in decibels, of 255 over the root of the mean square difference.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Likeness {
    /// Of luma.
    pub luma_db: f64,
    /// Of both chroma planes together.
    pub chroma_db: f64,
}

impl Planes {
    /// From the colours of two eyes, red, green and blue from 0 to 1, rows from the top. Written down from ITU-R BT.709,
    /// not from the shader that the server converts with; a chroma sample is the mean of its two by two pixels.
    #[must_use]
    pub fn of_eyes(eye_size_px: [u32; 2], eyes: [&[[f64; 3]]; 2]) -> Self {
        let [width, height] = eye_size_px.map(|side| side as usize);
        let colour = |x: usize, y: usize| eyes[x / width][y * width + x % width].map(|c| c.clamp(0.0, 1.0));
        let luma = |c: [f64; 3]| 0.2126 * c[0] + 0.7152 * c[1] + 0.0722 * c[2];
        let y = (0..height)
            .flat_map(|y| (0..2 * width).map(move |x| 16.0 + 219.0 * luma(colour(x, y))))
            .collect();
        let (mut u, mut v) = (Vec::new(), Vec::new());
        for y in 0..height / 2 {
            for x in 0..width {
                let mut mean = [0.0; 3];
                for (dx, dy) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
                    let pixel = colour(2 * x + dx, 2 * y + dy);
                    mean.iter_mut().zip(pixel).for_each(|(mean, c)| *mean += c / 4.0);
                }
                u.push(128.0 + 224.0 * (mean[2] - luma(mean)) / 1.8556);
                v.push(128.0 + 224.0 * (mean[0] - luma(mean)) / 1.5748);
            }
        }
        Self { size_px: [2 * width, height], y, u, v }
    }

    /// The picture that a renderer gives: colour times opacity, and opacity, before black.
    #[must_use]
    pub fn of_still(still: &render::Still) -> Self {
        let eye = |eye: usize| -> Vec<[f64; 3]> {
            still.eye(eye).iter().map(|p| [p[0], p[1], p[2]].map(f64::from)).collect()
        };
        Self::of_eyes(still.eye_size_px, [&eye(0), &eye(1)])
    }

    /// A picture as it was decoded.
    #[must_use]
    pub fn of_decoded(picture: &YuvPicture) -> Self {
        let layout = picture.layout();
        let [width, height] = [layout.width_px() as usize, layout.height_px() as usize];
        let plane = |bytes: &[u8], stride: usize, [width, height]: [usize; 2]| -> Vec<f64> {
            bytes.chunks(stride).take(height).flat_map(|row| &row[..width]).map(|&b| f64::from(b)).collect()
        };
        let frame = picture.as_frame();
        let half = [width / 2, height / 2];
        Self {
            size_px: [width, height],
            y: plane(frame.y(), layout.y_stride(), [width, height]),
            u: plane(frame.u(), layout.uv_stride(), half),
            v: plane(frame.v(), layout.uv_stride(), half),
        }
    }

    /// Luma of the brightest pixel, 16 to 235.
    #[must_use]
    pub fn brightest_luma(&self) -> f64 {
        self.y.iter().copied().fold(0.0, f64::max)
    }

    /// How alike this and another are.
    #[must_use]
    pub fn likeness(&self, other: &Self) -> Likeness {
        assert_eq!(self.size_px, other.size_px, "pictures of one size");
        let squares = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum::<f64>();
        let db = |squares: f64, count: usize| 10.0 * (255.0f64.powi(2) * count as f64 / squares).log10();
        Likeness {
            luma_db: db(squares(&self.y, &other.y), self.y.len()),
            chroma_db: db(
                squares(&self.u, &other.u) + squares(&self.v, &other.v),
                self.u.len() + self.v.len(),
            ),
        }
    }

    /// The middle of what is brighter than black in one eye (0 left, 1 right), in pixels from the eye's upper left
    /// corner, weighted by how much brighter; `None` if nothing is.
    #[must_use]
    pub fn centroid(&self, eye: usize) -> Option<[f64; 2]> {
        let [width, height] = self.size_px;
        let half = width / 2;
        let mut sums = [0.0; 3];
        for y in 0..height {
            for x in 0..half {
                // What the codec leaves of black is below this.
                let weight = (self.y[y * width + eye * half + x] - 24.0).max(0.0);
                sums[0] += weight * (x as f64 + 0.5);
                sums[1] += weight * (y as f64 + 0.5);
                sums[2] += weight;
            }
        }
        (sums[2] > 0.0).then(|| [sums[0] / sums[2], sums[1] / sums[2]])
    }

    /// The picture with its two eyes changed over.
    #[must_use]
    pub fn with_eyes_swapped(&self) -> Self {
        let swapped = |plane: &[f64], width: usize| -> Vec<f64> {
            let turned = |row: &[f64]| [&row[width / 2..], &row[..width / 2]].concat();
            plane.chunks(width).flat_map(turned).collect()
        };
        let width = self.size_px[0];
        Self {
            size_px: self.size_px,
            y: swapped(&self.y, width),
            u: swapped(&self.u, width / 2),
            v: swapped(&self.v, width / 2),
        }
    }

    /// Panics if another picture is less like this one than it must be, and leaves both and their difference as PNG of
    /// their luma.
    pub fn assert_alike(&self, found: &Self, least: Likeness, what: &str) -> Likeness {
        let likeness = self.likeness(found);
        if likeness.luma_db >= least.luma_db && likeness.chroma_db >= least.chroma_db {
            return likeness;
        }
        let folder = std::env::temp_dir().join("holocast-end-to-end");
        let _ = std::fs::create_dir_all(&folder);
        let stem: String = what.chars().map(|c| if c.is_alphanumeric() { c } else { '-' }).collect();
        let difference: Vec<f64> =
            self.y.iter().zip(&found.y).map(|(a, b)| 16.0 + 8.0 * (a - b).abs()).collect();
        let saved = [("expected", &self.y), ("found", &found.y), ("difference", &difference)]
            .map(|(name, plane)| self.save_luma(plane, folder.join(format!("{stem}-{name}.png"))));
        panic!("{what}: {likeness}, expected at least {least}; see {}", saved[0].display());
    }

    fn save_luma(&self, plane: &[f64], path: PathBuf) -> PathBuf {
        let bytes = plane.iter().map(|&y| ((y - 16.0) * 255.0 / 219.0).round() as u8).collect();
        let [width, height] = self.size_px.map(|side| side as u32);
        if let Some(picture) = image::GrayImage::from_raw(width, height, bytes) {
            let _ = picture.save(&path);
        }
        path
    }
}

impl fmt::Display for Likeness {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:.1} dB of luma and {:.1} dB of chroma", self.luma_db, self.chroma_db)
    }
}

//! JPEG-LS, lossless and near-lossless, of one component.
//!
//! Source: ITU-T T.87 (ISO/IEC 14495-1); the sections are named below. Why it is decoded here:
//! `docs/decisions/0017-dicom.md`.

/// Order of the run lengths, J of A.7.1.2.
const RUN_ORDER: [u32; 32] =
    [0, 0, 0, 0, 1, 1, 1, 1, 2, 2, 2, 2, 3, 3, 3, 3, 4, 4, 5, 5, 6, 6, 7, 7, 8, 9, 10, 11, 12, 13, 14, 15];
/// Contexts of regular samples.
const CONTEXTS: usize = 365;
/// Largest parameter of a Golomb code: more cannot come of samples of 16 bits.
const LARGEST_K: u32 = 24;

/// Decodes a picture that must have `width` × `height` samples; of more than 8 bits they take all of a `u16`.
pub(super) fn decode(data: &[u8], width: usize, height: usize) -> Result<Vec<u16>, String> {
    let header = Header::parse(data)?;
    if (header.width, header.height) != (width, height) {
        return Err(format!(
            "expected {width} × {height} px as the header says, found {} × {}",
            header.width, header.height
        ));
    }
    let mut picture = Vec::new();
    picture.try_reserve_exact(width * height).map_err(|e| e.to_string())?;
    let mut decoder = Decoder::new(&header, &data[header.scan_at..]);
    // A sample beyond each end: what T.87 says of the neighbours at the borders.
    let (mut before, mut line) = (vec![0; width + 2], vec![0; width + 2]);
    for _ in 0..height {
        before[width + 1] = before[width];
        line[0] = before[1];
        decoder.line(&before, &mut line)?;
        picture.extend(line[1..=width].iter().map(|&s| s as u16));
        std::mem::swap(&mut before, &mut line);
    }
    Ok(picture)
}

/// What the markers say (C.2).
#[derive(Debug, Default)]
struct Header {
    width: usize,
    height: usize,
    bits: u32,
    max_value: i32,
    thresholds: [i32; 3],
    reset: i32,
    near: i32,
    scan_at: usize,
}

impl Header {
    fn parse(data: &[u8]) -> Result<Self, String> {
        let mut header = Self::default();
        let mut preset = [0i32; 5];
        if !data.starts_with(&[0xff, 0xd8]) {
            return Err("no start of an image".to_owned());
        }
        let mut at = 2;
        loop {
            let [mark, kind, high, low] = data.get(at..at + 4).and_then(|m| m.try_into().ok()).ok_or(ENDS)?;
            let length = usize::from(u16::from_be_bytes([high, low]));
            if mark != 0xff || length < 2 {
                return Err(format!("expected a marker, found {mark:02x} {kind:02x}"));
            }
            let body = data.get(at + 4..at + 2 + length).ok_or(ENDS)?;
            let word = |i: usize| body.get(i..i + 2).map_or(0, |w| u16::from_be_bytes([w[0], w[1]]));
            let byte = |i: usize| body.get(i).copied().unwrap_or_default();
            at += 2 + length;
            match kind {
                0xf7 => {
                    header.bits = u32::from(byte(0));
                    header.height = word(1).into();
                    header.width = word(3).into();
                    if byte(5) != 1 || !(2..=16).contains(&header.bits) {
                        return Err(format!(
                            "{} components of {} bits: one of 2 to 16 is read",
                            byte(5),
                            header.bits
                        ));
                    }
                }
                0xf8 if byte(0) == 1 => preset = std::array::from_fn(|i| word(1 + 2 * i).into()),
                0xf8 => return Err("mapping tables are not read".to_owned()),
                0xdd if word(0) != 0 => return Err("restart intervals are not read".to_owned()),
                0xda => {
                    if byte(0) != 1 || byte(5) != 0 {
                        return Err("point transforms and several components are not read".to_owned());
                    }
                    header.near = byte(3).into();
                    header.scan_at = at;
                    break;
                }
                _ => {}
            }
        }
        if header.bits == 0 {
            return Err("no frame header".to_owned());
        }
        header.preset(preset)?;
        Ok(header)
    }

    /// The coding parameters, by default those of C.2.4.1.1.
    fn preset(&mut self, [max_value, t1, t2, t3, reset]: [i32; 5]) -> Result<(), String> {
        let most = (1 << self.bits) - 1;
        self.max_value = if max_value == 0 { most } else { max_value };
        let (max, near) = (self.max_value, self.near);
        if max > most || near > 255.min(max / 2) {
            return Err(format!("largest value {max} and error {near} do not fit {} bits", self.bits));
        }
        let clamp = |value: i32, low: i32| if value > max || value < low { low } else { value };
        let default = |basic: i32, floor: i32, times: i32| {
            if max >= 128 {
                (max.min(4095) + 128) / 256 * (basic - floor) + floor + times * near
            } else {
                floor.max(basic / (256 / (max + 1)) + times * near)
            }
        };
        let given = |value: i32, otherwise: i32| if value == 0 { otherwise } else { value };
        let t1 = given(t1, clamp(default(3, 2, 3), near + 1));
        let t2 = given(t2, clamp(default(7, 3, 5), t1));
        let t3 = given(t3, clamp(default(21, 4, 7), t2));
        self.thresholds = [t1, t2, t3];
        self.reset = given(reset, 64);
        if !(near < t1 && t1 <= t2 && t2 <= t3 && t3 <= max) || self.reset < 3 {
            return Err(format!("thresholds {t1}, {t2}, {t3} and reset {} cannot be", self.reset));
        }
        Ok(())
    }
}

const ENDS: &str = "the data end early";

/// Statistics of a context (A.2.1).
#[derive(Clone, Copy)]
struct Context {
    a: i32,
    b: i32,
    c: i32,
    n: i32,
}

impl Context {
    /// Parameter of the Golomb code (A.5.1).
    fn k(&self, a: i32) -> Result<u32, String> {
        (0..=LARGEST_K)
            .find(|k| i64::from(self.n) << k >= i64::from(a))
            .ok_or_else(|| "a code is too long".to_owned())
    }
}

struct Decoder<'a> {
    bits: Bits<'a>,
    contexts: Vec<Context>,
    /// Of run interruptions; `b` counts negative errors.
    runs: [Context; 2],
    run_index: usize,
    max_value: i32,
    near: i32,
    range: i32,
    range_bits: u32,
    limit: u32,
    thresholds: [i32; 3],
    reset: i32,
}

impl<'a> Decoder<'a> {
    fn new(header: &Header, scan: &'a [u8]) -> Self {
        let (max, near) = (header.max_value, header.near);
        let range = (max + 2 * near) / (2 * near + 1) + 1;
        let bits_of = |n: i32| (n - 1).checked_ilog2().map_or(0, |b| b + 1);
        let sample_bits = bits_of(max + 1).max(2);
        let context = Context { a: ((range + 32) / 64).max(2), b: 0, c: 0, n: 1 };
        Self {
            bits: Bits { data: scan, at: 0, held: 0, count: 0, after_ff: false },
            contexts: vec![context; CONTEXTS],
            runs: [context; 2],
            run_index: 0,
            max_value: max,
            near,
            range,
            range_bits: bits_of(range),
            limit: 2 * (sample_bits + sample_bits.max(8)),
            thresholds: header.thresholds,
            reset: header.reset,
        }
    }

    fn line(&mut self, before: &[i32], line: &mut [i32]) -> Result<(), String> {
        let width = line.len() - 2;
        let mut x = 1;
        while x <= width {
            let [left, up, up_left, up_right] = [line[x - 1], before[x], before[x - 1], before[x + 1]];
            let gradients = [up_right - up, up - up_left, up_left - left];
            if gradients.iter().any(|d| d.abs() > self.near) {
                line[x] = self.regular([left, up, up_left], gradients)?;
                x += 1;
                continue;
            }
            // A run of the value to the left (A.7.1).
            let run = self.run(width + 1 - x)?;
            line[x..x + run].fill(left);
            x += run;
            if x <= width {
                line[x] = self.interruption(left, before[x])?;
                x += 1;
            }
        }
        Ok(())
    }

    fn regular(&mut self, [left, up, up_left]: [i32; 3], gradients: [i32; 3]) -> Result<i32, String> {
        let [q1, q2, q3] = gradients.map(|d| self.quantised(d));
        let mixed = (q1 * 9 + q2) * 9 + q3;
        let sign = if mixed < 0 { -1 } else { 1 };
        let at = mixed.unsigned_abs() as usize;
        let context = self.contexts[at];
        // The median edge detector (A.4.1), corrected by what the context has learnt (A.4.2).
        let predicted = if up_left >= left.max(up) {
            left.min(up)
        } else if up_left <= left.min(up) {
            left.max(up)
        } else {
            left + up - up_left
        };
        let predicted = (predicted + sign * context.c).clamp(0, self.max_value);
        let k = context.k(context.a)?;
        let mapped = self.bits.golomb(k, self.limit, self.range_bits)?;
        let swapped = self.near == 0 && k == 0 && 2 * context.b <= -context.n;
        let half = (mapped >> 1) as i32;
        let error = match (mapped & 1 == 1, swapped) {
            (false, false) | (true, true) => half,
            _ => -half - 1,
        };
        self.contexts[at] = self.learnt(context, error);
        Ok(self.sample(predicted, sign * error))
    }

    /// A.6.
    fn learnt(&self, mut context: Context, error: i32) -> Context {
        context.b += error * (2 * self.near + 1);
        context.a += error.abs();
        if context.n >= self.reset {
            context.a >>= 1;
            context.b >>= 1;
            context.n >>= 1;
        }
        context.n += 1;
        if context.b <= -context.n {
            context.b = (context.b + context.n).max(1 - context.n);
            context.c = (context.c - 1).max(-128);
        } else if context.b > 0 {
            context.b = (context.b - context.n).min(0);
            context.c = (context.c + 1).min(127);
        }
        context
    }

    fn quantised(&self, d: i32) -> i32 {
        let [t1, t2, t3] = self.thresholds;
        let size = match d.abs() {
            n if n <= self.near => 0,
            n if n < t1 => 1,
            n if n < t2 => 2,
            n if n < t3 => 3,
            _ => 4,
        };
        size * d.signum()
    }

    /// Length of a run, at most `left`.
    fn run(&mut self, left: usize) -> Result<usize, String> {
        let mut run = 0;
        while self.bits.take(1)? == 1 {
            let full = 1usize << RUN_ORDER[self.run_index];
            if full <= left - run {
                // A run that the line's end cuts short does not count.
                self.run_index = (self.run_index + 1).min(31);
            }
            run += full.min(left - run);
            if run == left {
                return Ok(run);
            }
        }
        run += self.bits.take(RUN_ORDER[self.run_index])? as usize;
        if run >= left { Err("a run is longer than its line".to_owned()) } else { Ok(run) }
    }

    /// A.7.2.
    fn interruption(&mut self, left: i32, up: i32) -> Result<i32, String> {
        let alike = (left - up).abs() <= self.near;
        let context = self.runs[usize::from(alike)];
        let k = context.k(if alike { context.a + (context.n >> 1) } else { context.a })?;
        let limit = self.limit - RUN_ORDER[self.run_index] - 1;
        let mapped = self.bits.golomb(k, limit, self.range_bits)? as i32;
        self.run_index = self.run_index.saturating_sub(1);
        let shifted = mapped + i32::from(alike);
        let odd = shifted & 1;
        let size = (shifted + odd) / 2;
        let negative = (k != 0 || 2 * context.b >= context.n) == (odd == 1);
        let error = if negative { -size } else { size };
        let next = &mut self.runs[usize::from(alike)];
        next.b += i32::from(error < 0);
        next.a += (mapped + 1 - i32::from(alike)) >> 1;
        if next.n >= self.reset {
            next.a >>= 1;
            next.b >>= 1;
            next.n >>= 1;
        }
        next.n += 1;
        let sign = if !alike && left > up { -1 } else { 1 };
        Ok(self.sample(if alike { left } else { up }, sign * error))
    }

    /// The sample of a prediction and an error (A.4.4, A.4.5).
    fn sample(&self, predicted: i32, error: i32) -> i32 {
        let step = 2 * self.near + 1;
        let mut sample = predicted + error * step;
        if sample < -self.near {
            sample += self.range * step;
        } else if sample > self.max_value + self.near {
            sample -= self.range * step;
        }
        sample.clamp(0, self.max_value)
    }
}

/// Bits from the highest on. After a byte ff, a byte brings seven.
struct Bits<'a> {
    data: &'a [u8],
    at: usize,
    held: u64,
    count: u32,
    after_ff: bool,
}

impl Bits<'_> {
    fn fill(&mut self) {
        while self.count <= 48 {
            let Some(&byte) = self.data.get(self.at) else { return };
            // A marker ends the scan.
            if self.after_ff && byte >= 0x80 {
                return;
            }
            let bits = if self.after_ff { 7 } else { 8 };
            self.held = self.held << bits | u64::from(byte);
            self.count += bits;
            self.after_ff = byte == 0xff;
            self.at += 1;
        }
    }

    /// The next `bits`, at most 32.
    fn take(&mut self, bits: u32) -> Result<u32, String> {
        if self.count < bits {
            self.fill();
            if self.count < bits {
                return Err(ENDS.to_owned());
            }
        }
        self.count -= bits;
        Ok((self.held >> self.count & ((1 << bits) - 1)) as u32)
    }

    /// A code of limited length (A.5.3).
    fn golomb(&mut self, k: u32, limit: u32, range_bits: u32) -> Result<u32, String> {
        let most = limit - range_bits - 1;
        let mut zeros = 0;
        while self.take(1)? == 0 {
            zeros += 1;
            if zeros > most {
                return Err("a code is too long".to_owned());
            }
        }
        if zeros < most { Ok(zeros << k | self.take(k)?) } else { Ok(self.take(range_bits)? + 1) }
    }
}

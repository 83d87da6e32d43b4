// What a voxel cell is to a ray: the trilinear field on a straight way is a cubic, and the transfer function between two of
// its knots is linear.

// A linear stretch of the transfer function. The Rust mirror is `GpuStretch`; a test compares the layouts.
struct Stretch {
    // The values from which and up to which it holds. Beyond the outermost knots it goes on for ever, and is constant.
    value_from: f32,
    value_to: f32,
    // Of a millimetre; in the mode maximum as it stands.
    opacity_from: f32,
    opacity_to: f32,
    color_from: vec3<f32>,
    // 1 / (value_to - value_from), or 0 where it is constant.
    per_value: f32,
    color_to: vec3<f32>,
    // Stretches with opacity before this one.
    seen_before: u32,
}

// The shortest piece, as a part of the way through a cell: behind it, light of the densest matter is spent.
const LEAST_PIECE: f32 = 1.52587890625e-5;
// Pieces of lit matter begin no longer: a highlight is narrow.
const LIT_PIECE: f32 = 0.25;
// How far gradients of neighbouring nodes may differ, as a part of the smaller one. Lit colour as a function of the place
// has its singularity where the gradient is 0; up to this difference that lies half a piece away or farther.
const GRADIENT_APART: f32 = 0.5;
// Rounds of six guesses each.
const ROOT_ROUNDS: i32 = 4;
// More than two shares of a label can be apart by rounding: each is a sum of eight products.
const SHARE_ROUNDING: f32 = 1.0e-5;
const LN_2: f32 = 0.69314718;

fn is_seen(s: Stretch) -> bool {
    return s.opacity_from > 0.0 || s.opacity_to > 0.0;
}

// Colour and opacity of a value that lies in a stretch, or off it by no more than rounding.
fn optical_in(s: Stretch, value: f32) -> vec4<f32> {
    let part = select(clamp((value - s.value_from) * s.per_value, 0.0, 1.0), 0.0, s.per_value == 0.0);
    let low = vec4<f32>(s.color_from, s.opacity_from);
    return low + (vec4<f32>(s.color_to, s.opacity_to) - low) * part;
}

// -ln(1 - o), with the digits of a small o.
fn extinction_of(opacity: f32) -> f32 {
    if (opacity < 0.03) {
        return opacity * (1.0 + opacity * (0.5 + opacity * (0.33333333 + opacity * (0.25 + opacity * 0.2))));
    }
    return -log(1.0 - opacity);
}

fn corner(i: u32) -> vec3<i32> {
    return vec3<i32>(i32(i & 1u), i32((i >> 1u) & 1u), i32(i >> 2u));
}

// The trilinear interpolation of eight corners on the straight way from a to b: coefficients of 1, u, u², u³.
fn across(c: array<f32, 8>, a: vec3<f32>, b: vec3<f32>) -> vec4<f32> {
    let d = b - a;
    let x0 = c[1] - c[0];
    let x1 = c[3] - c[2];
    let x2 = c[5] - c[4];
    let x3 = c[7] - c[6];
    let y0 = c[2] - c[0];
    let xy = x1 - x0;
    let xz = x2 - x0;
    let yz = (c[6] - c[4]) - y0;
    let xyz = (x3 - x2) - xy;
    let slope = vec3<f32>(
        x0 + xy * a.y + (xz + xyz * a.y) * a.z,
        y0 + xy * a.x + (yz + xyz * a.x) * a.z,
        (c[4] - c[0]) + xz * a.x + (yz + xyz * a.x) * a.y,
    );
    let low = (c[0] + x0 * a.x) + ((c[2] + x1 * a.x) - (c[0] + x0 * a.x)) * a.y;
    let high = (c[4] + x2 * a.x) + ((c[6] + x3 * a.x) - (c[4] + x2 * a.x)) * a.y;
    return vec4<f32>(
        low + (high - low) * a.z,
        dot(slope, d),
        d.x * d.y * (xy + xyz * a.z) + d.x * d.z * (xz + xyz * a.y) + d.y * d.z * (yz + xyz * a.x),
        d.x * d.y * d.z * xyz,
    );
}

fn cubic_at(c: vec4<f32>, u: f32) -> f32 {
    return c.x + u * (c.y + u * (c.z + u * c.w));
}

// a / b where it lies between 0 and 1, else 1.
fn part_of(a: f32, b: f32) -> f32 {
    if (a != 0.0 && abs(a) < abs(b) && (a > 0.0) == (b > 0.0)) {
        return a / b;
    }
    return 1.0;
}

// Where a cubic turns between 0 and 1, in order; 1 where it does not.
fn turns_of(c: vec4<f32>) -> vec2<f32> {
    let size = max(max(abs(c.y), abs(c.z)), abs(c.w));
    if (!(size > 0.0)) {
        return vec2<f32>(1.0);
    }
    // Scaled: squares of a float volume's differences may be too small for float32.
    let q = c.yzw / size;
    let quarter = q.y * q.y - 3.0 * q.z * q.x;
    if (quarter <= 0.0) {
        return vec2<f32>(1.0);
    }
    let sum = -(q.y + select(-1.0, 1.0, q.y >= 0.0) * sqrt(quarter));
    let a = part_of(sum, 3.0 * q.z);
    let b = part_of(q.x, sum);
    return vec2<f32>(min(a, b), max(a, b));
}

// A bracket around a root, and the guess within it.
struct Bracket {
    low: f32,
    high: f32,
    u: f32,
}

// The bracket after a look at its guess: the next is Newton's, or the middle where that leads out of it or is not wanted.
fn closer(b: Bracket, c: vec4<f32>, value: f32, rises: bool, newton: bool) -> Bracket {
    let off = cubic_at(c, b.u) - value;
    var next = b;
    if ((off > 0.0) == rises) {
        next.high = b.u;
    } else {
        next.low = b.u;
    }
    next.u = 0.5 * (next.low + next.high);
    let slope = c.y + b.u * (2.0 * c.z + b.u * 3.0 * c.w);
    if (newton && abs(off) < abs(slope)) {
        let guess = b.u - off / slope;
        if (guess >= next.low && guess <= next.high) {
            next.u = guess;
        }
    }
    return next;
}

// Where a cubic that does not turn between low and high meets a value.
fn root_of(c: vec4<f32>, low: f32, high: f32, value: f32) -> f32 {
    let rises = cubic_at(c, high) > cubic_at(c, low);
    var b = Bracket(low, high, 0.5 * (low + high));
    for (var k = 0; k < ROOT_ROUNDS; k += 1) {
        let before = b.u;
        // One halving, lest a bend keeps Newton's method to one side; after that it would only lose what was won.
        b = closer(closer(closer(b, c, value, rises, true), c, value, rises, true), c, value, rises, k > 0);
        b = closer(closer(closer(b, c, value, rises, true), c, value, rises, true), c, value, rises, true);
        if (b.u == before) {
            break;
        }
    }
    return b.u;
}

fn is_apart(a: vec3<f32>, b: vec3<f32>) -> bool {
    let d = b - a;
    return dot(d, d) > GRADIENT_APART * GRADIENT_APART * min(dot(a, a), dot(b, b));
}

// Boole's rule: the integral over five nodes a quarter apart, and those from the first node to each.
fn boole(at_0: f32, at_1: f32, at_2: f32, at_3: f32, at_4: f32) -> f32 {
    return (7.0 * (at_0 + at_4) + 32.0 * (at_1 + at_3) + 12.0 * at_2) / 90.0;
}

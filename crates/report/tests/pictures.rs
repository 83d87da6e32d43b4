//! What the pictures show.

use report::{Axis, FrameRecord, HeadsetRun, Picture, Plot, Point, Run, StageNames, latency, latency_of};

mod common;

type Colour = [u8; 3];

const SKY: Colour = [0x56, 0xb4, 0xe9];
const ORANGE: Colour = [0xe6, 0x9f, 0x00];
const ALARM: Colour = [0xb0, 0x00, 0x20];
/// The colours of the stages that work, in order, and of those that wait.
const STAGES: [Colour; 10] = [
    SKY,
    [0xd2, 0xd2, 0xd2],
    ORANGE,
    [0xf0, 0xe4, 0x42],
    [0xa6, 0xa6, 0xa6],
    [0x00, 0x9e, 0x73],
    [0xd5, 0x5e, 0x00],
    [0x00, 0x72, 0xb2],
    [0x80, 0x80, 0x80],
    [0xcc, 0x79, 0xa7],
];

struct Pixels {
    size: [u32; 2],
    rgb: Vec<u8>,
}

impl Pixels {
    fn of(picture: &Picture, scale: u32) -> Self {
        let png = picture.to_png(scale);
        let mut reader = png::Decoder::new(std::io::Cursor::new(png)).read_info().expect("a PNG header");
        let mut rgb = vec![0; reader.output_buffer_size().expect("a size that fits memory")];
        let info = reader.next_frame(&mut rgb).expect("PNG pixels");
        assert_eq!(info.color_type, png::ColorType::Rgb);
        Self { size: [info.width, info.height], rgb }
    }

    fn count(&self, colour: Colour) -> usize {
        self.rgb.chunks_exact(3).filter(|pixel| *pixel == colour).count()
    }
}

/// A run of frames that are all alike: stages of 10 ms and 20 ms, 30 times a second.
fn alike(frames: u64, lateness_us: i64) -> Run {
    let record = |frame: u64| FrameRecord {
        frame,
        decoded_at_secs: (frame + 1) as f64 / 30.0,
        stages_us: vec![10_000, 20_000],
        pose_to_decoded_us: 30_000,
        lateness_us,
        resolution_scale: 1.0,
        step_scale: 1.0,
        ..FrameRecord::default()
    };
    let headset = HeadsetRun {
        name: "a".to_owned(),
        seconds: frames as f64 / 30.0,
        asked_hz: 30.0,
        full_step_scale: 1.0,
        frames: (0..frames).map(record).collect(),
        ..HeadsetRun::default()
    };
    Run { stages: StageNames::new(["uplink", "render"]), headsets: vec![headset], ..Run::default() }
}

#[test]
fn every_stage_is_painted_in_its_colour() {
    for seconds in [10.0, 60.0] {
        let pixels = Pixels::of(&latency(&common::run(2, seconds)), 1);
        for (colour, name) in STAGES.into_iter().zip(common::STAGES) {
            // A swatch of the legend is 20 by 12 pixels with a border; sending takes no time to speak of.
            let least = if name == "send" { 170 } else { 400 };
            assert!(pixels.count(colour) > least, "{name}: {} pixels in {seconds} s", pixels.count(colour));
        }
    }
}

#[test]
fn a_stage_of_twice_the_time_has_twice_the_area() {
    for frames in [60, 2_000] {
        let pixels = Pixels::of(&latency(&alike(frames, -1)), 1);
        // The legend has a swatch of each. A grid line and the total line lie over the areas.
        let [sky, orange] = [SKY, ORANGE].map(|colour| pixels.count(colour) as f64 - 200.0);
        assert!((orange / sky - 2.0).abs() < 0.08, "{frames} frames: {sky} and {orange} pixels");
        // The 1064 by 270 pixels stand for the whole time and two intervals of 33.3 ms.
        let share = sky / (1064.0 * 270.0);
        assert!((share - 10.0 / 66.7).abs() < 0.01, "{frames} frames: {share} of the area");
    }
}

#[test]
fn late_frames_are_marked() {
    let [in_time, late] = [-1, 1].map(|lateness| Pixels::of(&latency(&alike(60, lateness)), 1).count(ALARM));
    // Marked all along the row, against the legend's swatch.
    assert!(late > in_time + 10_000, "{late} against {in_time} pixels");
}

#[test]
fn a_run_without_frames_says_so() {
    for (run, panels) in [(common::run(1, 0.0), 1), (common::run(3, 0.0), 3), (Run::default(), 1)] {
        let picture = latency(&run);
        assert_eq!(picture.to_svg().matches("no frames").count(), panels);
        let pixels = Pixels::of(&picture, 1);
        assert!(pixels.rgb.chunks_exact(3).any(|pixel| pixel[0] < 0x80), "blank");
    }
}

#[test]
fn both_forms_have_the_size_of_the_layout() {
    let picture = latency(&common::run(1, 1.0));
    let [width, height] = picture.size_px();
    assert_eq!(Pixels::of(&picture, 2).size, [2 * width, 2 * height]);
    let svg = picture.to_svg();
    assert!(svg.contains(&format!("viewBox=\"0 0 {width} {height}\"")), "{}", &svg[..200]);
    assert!(svg.starts_with("<svg ") && svg.ends_with("</svg>\n"));
}

#[test]
fn text_from_outside_stays_text() {
    let mut run = common::run(1, 0.1);
    run.title = "<script>&\u{1}</script>".to_owned();
    let svg = latency(&run).to_svg();
    assert!(svg.contains("&lt;script&gt;&amp;&lt;/script&gt;"));
    assert!(!svg.contains("<script"));
}

#[test]
fn of_many_headsets_three_are_shown() {
    let mut run = common::run(9, 1.0);
    for (index, headset) in run.headsets.iter_mut().enumerate() {
        headset.counters.decoded = 10 + index as u64;
    }
    let svg = latency(&run).to_svg();
    let shown =
        run.headsets.iter().map(|headset| svg.contains(&format!(">{}<", headset.name))).collect::<Vec<_>>();
    let expected: Vec<bool> = (0..9).map(|index| [0, 4, 8].contains(&index)).collect();
    assert_eq!(shown, expected);
}

#[test]
fn a_headset_is_found_by_its_name() {
    let run = common::run(2, 0.5);
    assert!(latency_of(&run, "door-2").unwrap().to_svg().contains(">door-2<"));
    assert!(latency_of(&run, "nobody").is_none());
}

#[test]
fn wild_numbers_do_not_stop_a_report() {
    let mut run = alike(5, 0);
    let wild =
        [(f64::NAN, i64::MIN), (f64::INFINITY, i64::MAX), (-1e300, i64::MAX), (1e300, -7), (0.5, i64::MAX)];
    for (frame, (secs, us)) in run.headsets[0].frames.iter_mut().zip(wild) {
        frame.decoded_at_secs = secs;
        frame.stages_us = vec![us, us];
        frame.pose_to_decoded_us = us;
        frame.lateness_us = us;
        frame.bytes = u64::MAX / 16;
        frame.resolution_scale = f64::NAN;
        frame.step_scale = 0.0;
    }
    for seconds in [0.0, 1.0, f64::INFINITY, f64::NAN] {
        run.seconds = seconds;
        run.headsets[0].seconds = seconds;
        run.headsets[0].asked_hz = seconds;
        assert!(!Pixels::of(&latency(&run), 1).rgb.is_empty());
        assert!(!report::RunReport::from(&run).to_string().is_empty());
    }
}

#[test]
fn a_plot_shows_its_series_and_their_front() {
    let plot = Plot::new("Time against error", Axis::log("time, ms"), Axis::log("error"))
        .lines("fast", [Point::new(1.0, 0.1), Point::new(4.0, 0.01)])
        .scatter("exact", [Point::labelled(9.0, 0.0, "float64"), Point::new(f64::NAN, 1.0)])
        .with_pareto_front();
    let svg = plot.picture().to_svg();
    for text in ["Time against error", "time, ms", "error", "fast", "exact", "float64", "Pareto front"] {
        assert!(svg.contains(&format!(">{text}<")), "{text} is missing");
    }
    // Two dots and one in the legend; the error of 0 has no place on a logarithmic axis and is hollow.
    assert_eq!(svg.matches("<circle").count() - svg.matches("fill=\"#ffffff\" stroke=").count(), 4);
    let pixels = Pixels::of(&plot.picture(), 1);
    assert!(pixels.count([0x00, 0x72, 0xb2]) > 100);
    assert!(pixels.count(ORANGE) > 20);
}

#[test]
fn a_plot_without_points_says_so() {
    let plot = Plot::new("", Axis::linear("x"), Axis::log("y")).scatter("none", [Point::new(f64::NAN, 1.0)]);
    assert!(plot.picture().to_svg().contains("no points"));
}

#[test]
fn a_plots_points_are_read_back_as_they_were() {
    let axes = || (Axis::linear("x, ms"), Axis::log("y"));
    let (x, y) = axes();
    let plot = Plot::new("title", x, y)
        .scatter("a, b", [Point::labelled(0.1, 3e-9, "\"one\""), Point::new(2.0, 1.0)])
        .scatter("c", [Point::new(-1.0, 5.0)]);
    let (x, y) = axes();
    let again = Plot::new("title", x, y).scatter_csv(plot.to_csv().as_bytes()).unwrap();
    assert_eq!(again, plot);
    assert!(Plot::default().scatter_csv("series,x,y,label\na,b,1,\n".as_bytes()).is_err());
    assert!(Plot::default().scatter_csv("x,y\n".as_bytes()).is_err());
}

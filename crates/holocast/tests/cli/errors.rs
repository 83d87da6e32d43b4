//! What goes wrong is said: which file, what was expected, what was found, what to do.

use crate::files::{Folder, nifti};
use crate::program::{Said, holocast, run};

#[test]
fn a_volume_that_is_none_is_named_with_what_is_wrong() {
    let folder = Folder::new();
    let good = nifti();
    let spoilt = |at: usize, bytes: &[u8]| {
        let mut spoilt = good.clone();
        spoilt[at..at + bytes.len()].copy_from_slice(bytes);
        spoilt
    };
    std::fs::create_dir(folder.path("folder.nii")).unwrap();
    folder.write("truncated.nii", &good[..good.len() - 100]);
    folder.write("header-only.nii", &good[..200]);
    folder.write("magic.nii", &spoilt(344, b"nope"));
    folder.write("huge.nii", &spoilt(42, &[0xff, 0x7f, 0xff, 0x7f, 0xff, 0x7f]));
    folder.write("negative.nii", &spoilt(42, &(-5i16).to_le_bytes()));
    folder.write("empty.nii", &[]);
    folder.write("text.nii", b"this is no volume");
    folder.write("cut.nii.gz", &[0x1f, 0x8b, 8, 0, 0, 0, 0, 0, 0, 3, 0x63]);
    folder.write("picture.png", b"\x89PNG\r\n\x1a\n");
    folder.write(
        "raw.json",
        br#"{"raw": "nowhere.raw", "dims": [4, 4, 4], "type": "uint8", "spacing_mm": [1, 1, 1]}"#,
    );
    folder.write("field.json", br#"{"raw": "nowhere.raw", "fog": 1}"#);
    for (name, why) in [
        ("nowhere.nii", &["No such file"][..]),
        ("truncated.nii", &["2272", "2172"]),
        ("header-only.nii", &["expected 344 bytes of header after its first 4", "196"]),
        ("magic.nii", &["nope"]),
        ("huge.nii", &["70362301923326 bytes", "17179869184"]),
        ("negative.nii", &["-5"]),
        ("empty.nii", &["empty"]),
        ("text.nii", &["NIfTI"]),
        ("cut.nii.gz", &[]),
        ("picture.png", &[]),
        ("raw.json", &["nowhere.raw"]),
        ("field.json", &["fog"]),
        ("folder.nii", &["a folder of 0 files, none of them DICOM"]),
    ] {
        let path = folder.arg(name);
        let said = run(["info", &path]);
        println!("{}", said.err.trim_end());
        assert!(said.err.matches("No such file").count() <= 1, "said twice: {}", said.err);
        // A header that is as it should be is not to blame for the file that it names.
        let named = if name == "raw.json" { "nowhere.raw" } else { name };
        said.failed(&[&[named][..], why].concat());
    }
    // The other commands say the same.
    let (path, out) = (folder.arg("truncated.nii"), folder.arg("picture.png"));
    run(["render", "--volume", &path, "--out", &out]).failed(&["truncated.nii", "2172"]);
    run(["serve", "--volume", &path, "--listen", "127.0.0.1:0", "--identity", &folder.arg("identity")])
        .failed(&["truncated.nii", "2172"]);
}

#[test]
fn a_scene_that_is_none_is_named_with_what_is_wrong() {
    let folder = Folder::new();
    let out = folder.arg("picture.png");
    for (name, json, why) in [
        ("field.json", r#"{"volume": "ball.nii", "fog": 1}"#, &["unknown field", "fog"][..]),
        ("nan.json", r#"{"volume": "ball.nii", "threshold": NaN}"#, &["line 1 column"]),
        ("infinite.json", r#"{"volume": "ball.nii", "threshold": 1e999}"#, &["out of range"]),
        (
            "falling.json",
            r#"{"volume": "ball.nii", "transfer": [[0,0,0,0,0],[9,1,1,1,1],[5,1,1,1,1]]}"#,
            &["transfer", "5", "9"],
        ),
        ("opacity.json", r#"{"volume": "ball.nii", "transfer": [[0,0,0,0,1.5]]}"#, &["transfer", "1.5"]),
        ("mode.json", r#"{"volume": "ball.nii", "mode": "magic"}"#, &["magic", "x-ray"]),
        ("window.json", r#"{"volume": "ball.nii", "window": [9, 3]}"#, &["window", "9", "3"]),
        ("channel.json", r#"{"volume": "ball.nii", "channel": 7}"#, &["7"]),
        ("size.json", r#"{"volume": "ball.nii", "size": [0, 10]}"#, &["size", "0"]),
        ("lost.json", r#"{"volume": "lost.nii"}"#, &["lost.nii"]),
        ("none.json", "{}", &["no volume", "--volume"]),
        ("cut.json", r#"{"volume": "ball.nii""#, &["EOF"]),
        ("list.json", "[]", &["found a list"]),
    ] {
        let scene = folder.write(name, json.as_bytes());
        let said = run(["render", "--scene", &scene, "--out", &out]);
        println!("{name}: {}", said.err.trim_end());
        // A scene's volume is named by its own path, a lacking one by what to do.
        let names_itself = !matches!(name, "lost.json" | "none.json");
        let own_name: &[&str] = if names_itself { &[name] } else { &[] };
        said.failed(&[own_name, why].concat());
    }
    run(["render", "--scene", &folder.arg("nowhere.json"), "--out", &out])
        .failed(&["nowhere.json", "cannot be read"]);
    assert!(!folder.path("picture.png").exists());
}

#[test]
fn arguments_that_are_none_are_told_with_what_there_is() {
    let folder = Folder::new();
    let (volume, out) = (folder.volume(), folder.arg("picture.png"));
    let render = |more: &[&str]| run([&["render", "--volume", &volume, "--out", &out][..], more].concat());
    for size in ["0x5", "640", "axb", "-1x5", "99999999999x1"] {
        render(&[&format!("--size={size}")]).failed(&[size, "640x360"]);
    }
    render(&["--size", "100000x60000"]).failed(&["100000", "16384"]);
    render(&["--quality", "superb"]).failed(&["superb", "draft, balanced, fine, exact"]);
    render(&["--step-mm", "0"]).failed(&["step"]);
    render(&["--quality", "balanced", "--step-mm", "1e-9"]).failed(&["step", "samples"]);
    render(&["--adapter", "nonesuch"]).failed(&["nonesuch"]);
    run(["render", "--volume", &volume, "--out", &folder.arg("nowhere/picture.png")])
        .failed(&["nowhere/picture.png", "cannot be written"]);
    run(["render", "--volume", &volume, "--out", &folder.arg("picture.xyz")])
        .failed(&["picture.xyz", "cannot be written"]);
    run(["render", "--volume", &volume]).failed(&["--out"]);
    run(["dance"]).failed(&["dance"]);

    let identity = folder.arg("identity");
    let serve = |more: &[&str]| {
        let common = ["serve", "--volume", &volume, "--identity", &identity];
        run([&common[..], more].concat())
    };
    serve(&["--listen", "nowhere"]).failed(&["nowhere", "--listen"]);
    serve(&["--listen", "203.0.113.7:0"]).failed(&["203.0.113.7", "no such address", "0.0.0.0"]);
    serve(&["--listen", "127.0.0.1:0", "--quality", "superb"]).failed(&["superb", "draft"]);
    serve(&["--listen", "127.0.0.1:0", "--adapter", "nonesuch"]).failed(&["nonesuch"]);
    run(["serve", "--listen", "127.0.0.1:0", "--identity", &identity]).failed(&["no volume", "--volume"]);

    let fingerprint = "0".repeat(64);
    let headset = |more: &[&str]| {
        run([&["headset", "--connect", "127.0.0.1:9", "--trace", "orbit"][..], more].concat())
    };
    headset(&["--fingerprint", "12"]).failed(&["fingerprint"]);
    let with = |more: &[&str]| headset(&[&["--fingerprint", &fingerprint][..], more].concat());
    with(&["--device", "quest"]).failed(&["quest", "hololens1"]);
    with(&["--device", "97x64"]).failed(&["97", "even"]);
    with(&["--hz", "0"]).failed(&["--hz", "1 to 240"]);
    with(&["--seconds", "nan"]).failed(&["--seconds"]);
    with(&["--ending", "never"]).failed(&["never", "ping-pong"]);
    with(&["--hologram", "1,2"]).failed(&["1,2"]);
    with(&["--change-scene", "1"]).failed(&["SECONDS:SCENE.json"]);
    let trace = folder.write("broken.tum", b"0 0 0 0 0 0 0 0 0 0\n");
    run(["headset", "--connect", "127.0.0.1:9", "--fingerprint", &fingerprint, "--trace", &trace])
        .failed(&["broken.tum"]);
    run(["load", "--connect", "127.0.0.1:9", "--fingerprint", &fingerprint, "--headsets", "0"])
        .failed(&["--headsets", "1 to 500"]);
}

#[test]
fn without_a_driver_it_is_said_what_to_install() {
    let folder = Folder::new();
    let (volume, identity, out) = (folder.volume(), folder.arg("identity"), folder.arg("picture.png"));
    for arguments in [
        &["adapters"][..],
        &["render", "--volume", &volume, "--out", &out],
        &["serve", "--volume", &volume, "--identity", &identity, "--listen", "127.0.0.1:0"],
    ] {
        let mut command = holocast(arguments);
        // Where Vulkan's loader is told to look for drivers, by its new name and its old one.
        command.env("VK_DRIVER_FILES", "/nowhere").env("VK_ICD_FILENAMES", "/nowhere");
        Said::from(command.output().unwrap()).failed(&["no Vulkan adapter", "mesa-vulkan-drivers"]);
    }
}

//! The binary where it needs no Vulkan: `info`, `compare`, and everything that is refused before a device is made.

use std::fs;
use std::path::PathBuf;
use std::process::{Command, Output, Stdio};

use crate::common::data;

fn surfel(args: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_surfel")).args(args).output().expect("the binary starts")
}

fn stdout(output: &Output) -> String {
    String::from_utf8_lossy(&output.stdout).into_owned()
}

fn stderr(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

/// A folder of this process's own for one test.
fn folder(test: &str) -> PathBuf {
    let path = std::env::temp_dir().join(format!("surfel-cli-{test}-{}", std::process::id()));
    fs::create_dir_all(&path).expect("a temporary folder");
    path
}

fn usage(args: &[&str], says: &str) {
    let output = surfel(args);
    assert_eq!(output.status.code(), Some(2), "{args:?}: {}", stderr(&output));
    assert!(stderr(&output).contains(says), "{args:?}: {}", stderr(&output));
}

/// Exit 1 and one line, which names `file`.
fn refused(args: &[&str], file: &str) -> String {
    let output = surfel(args);
    let text = stderr(&output);
    assert_eq!(output.status.code(), Some(1), "{args:?}: {text}");
    assert_eq!(text.lines().count(), 1, "{text}");
    assert!(text.starts_with("surfel: ") && text.contains(file), "{args:?}: {text}");
    text
}

#[test]
fn what_cannot_be_meant_is_a_usage_error() {
    let render =
        |more: &[&str], says: &str| usage(&[&["render", "scene:torus:99", "-o", "x.png"], more].concat(), says);
    usage(&[], "Usage");
    usage(&["render", "scene:torus"], "--output");
    usage(&["render", "scene:nothing", "-o", "x.png"], "there is no scene");
    usage(&["render", "scene:torus", "-o", "x.jpg"], ".png");
    render(&["--size", "0x5"], "at least 1");
    render(&["--size", "5000000000x1"], "size");
    render(&["--fov", "0"], "angle");
    render(&["--fov", "180"], "angle");
    render(&["--eye", "1,2,3"], "--target");
    render(&["--eye", "1,2,3", "--target", "1,2,3"], "same place");
    render(&["--eye", "0,0,1", "--target", "0,0,0", "--up", "z"], "--up lies along");
    render(&["--orbit", "0,0,2", "--eye", "1,2,3", "--target", "0,0,0"], "cannot be used with");
    render(&["--orbit", "0,100,2"], "elevation");
    render(&["--view", "border", "--orbit", "0,0,2"], "cannot be used with");
    render(&["--view", "border", "--eye", "1,2,3", "--target", "0,0,0"], "cannot be used with");
    render(&["--view", "sideways"], "centre");
    usage(&["bench", "scene:torus:99", "--out", "x", "--views", "distance,sideways"], "\"sideways\" is no view");
    usage(&["bench", "scene:torus:99", "--out", "x", "--views", "0"], "1 to 1000");
    render(&["--background", "red"], "hexadecimal");
    render(&["--radius", "-1"], "radius");
    render(&["--radius", "px:2", "--blend", "two-pass"], "opaque");
    render(&["--blend", "sideways"], "two-pass");
    render(&["--structure", "octree"], "flat");
    render(&["--frames", "0"], "frames");
    assert!(!PathBuf::from("x.png").exists());
}

#[test]
fn what_truth_cannot_be_is_a_usage_error() {
    let reference =
        |more: &[&str], says: &str| usage(&[&["reference", "scene:torus:99", "-o", "x.png"], more].concat(), says);
    usage(&["reference", "scene:torus:99", "-o", "x.jpg"], ".exr");
    reference(&["--truth", "hearsay"], "supersampled");
    reference(&["--samples", "4"], "--truth");
    reference(&["--samples", "3", "--truth", "supersampled"], "16 or 32");
    reference(&["--samples", "0", "--truth", "mesh"], "samples");
    reference(&["--eye", "1,2,3"], "--target");
    reference(&["--radius", "px:2", "--blend", "two-pass"], "opaque");
    assert!(!PathBuf::from("x.png").exists());
}

/// A square of two faces in the plane z = 0, the corners (±1, ±1), white.
const SQUARE: &str = "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n\
    property uchar red\nproperty uchar green\nproperty uchar blue\nelement face 2\n\
    property list uchar int vertex_indices\nend_header\n-1 -1 0 255 255 255\n1 -1 0 255 255 255\n1 1 0 255 255 255\n\
    -1 1 0 255 255 255\n3 0 1 2\n3 0 2 3\n";

/// Every truth of one square, as PNG and as EXR, where there is no Vulkan driver at all.
#[test]
fn the_reference_needs_no_device() {
    let here = folder("reference");
    let path = |name: &str| here.join(name).to_string_lossy().into_owned();
    let square = path("square.ply");
    fs::write(&square, SQUARE).unwrap();
    let draw = |out: &str, more: &[&str]| {
        let view = ["--size", "40x40", "--eye", "0,0,4", "--target", "0,0,0", "--fov", "53.13010235415598"];
        let output = Command::new(env!("CARGO_BIN_EXE_surfel"))
            .args(["reference", &square, "-o", out, "--shade", "none"])
            .args(view)
            .args(more)
            .env("VK_DRIVER_FILES", "/nonexistent")
            .env("VK_ICD_FILENAMES", "/nonexistent")
            .output()
            .unwrap();
        assert!(output.status.success(), "{more:?}: {}", stderr(&output));
        stdout(&output)
    };
    // tan(fov / 2) = 1/2: 40 px are 4 units across, so the square is pixels 10 to 29.
    let (png, exr) = (path("mesh.png"), path("mesh.exr"));
    let said = draw(&png, &["--truth", "mesh", "--background", "000000", "--samples", "3"]);
    assert!(said.contains("3 x 3 a pixel") && said.contains("triangles          2"), "{said}");
    let bytes = image::open(&png).unwrap().into_rgb8();
    assert_eq!(draw(&exr, &["--truth", "mesh", "-q"]), format!("{exr}\n"));
    let floats = surfel::exr::FloatPicture::read(&exr).unwrap();
    let depth = floats.depth.as_ref().unwrap();
    for (i, (x, y)) in (0..40).flat_map(|y| (0..40).map(move |x| (x, y))).enumerate() {
        let inside = (10..30).contains(&x) && (10..30).contains(&y);
        assert_eq!(bytes.get_pixel(x, y).0, if inside { [255; 3] } else { [0; 3] }, "{x}, {y}");
        assert_eq!(floats.rgba[i], if inside { [1.0; 4] } else { [0.0; 4] }, "{x}, {y}");
        assert_eq!(depth[i], if inside { 4.0 } else { f32::INFINITY }, "{x}, {y}");
    }
    // Four splats at the square's corners, of 5 px and as discs of 5 / √2 px.
    for more in [&["--truth", "supersampled"][..], &["--truth", "none"], &["--truth", "none", "--blend", "opaque"]] {
        let out = path("splats.exr");
        let said = draw(&out, &[more, &["--radius", "0.5"]].concat());
        assert!(said.contains("4 in the input, 4 drawn"), "{said}");
        let splats = surfel::exr::FloatPicture::read(&out).unwrap();
        let at = |x: usize, y: usize| splats.rgba[40 * y + x];
        assert_eq!([at(10, 10), at(20, 20), at(2, 10)], [[1.0; 4], [0.0; 4], [0.0; 4]], "{more:?}");
        assert!(at(8, 10)[3] > 0.0, "{more:?}");
    }
    let points = path("points.ply");
    fs::write(&points, SQUARE.replace("element face 2", "element face 0").split("3 0 1 2").next().unwrap()).unwrap();
    let refusal = refused(&["reference", &square, &points, "-o", &png, "--truth", "mesh", "-q"], "points.ply");
    assert!(refusal.contains("needs faces"), "{refusal}");
    refused(&["reference", "scene:torus:99", "-o", &png, "--truth", "mesh", "-q"], "scene:torus");
    refused(&["reference", &png, "-o", &png], "overwritten");
    fs::remove_dir_all(here).unwrap();
}

#[test]
fn help_names_every_option() {
    let help = stdout(&surfel(&["render", "--help"]));
    let options = "size structure blend threshold orbit eye target view up fov background shade color radius primitive ellipse \
                   tolerance frames warmup stats device validate selection interval error clusters block tree packing scanner \
                   samples";
    for option in options.split_whitespace() {
        assert!(help.contains(&format!("--{option}")), "{option}");
    }
}

#[test]
fn with_data_a_scanners_step_is_told_and_makes_radii() {
    let here = folder("step");
    let out = here.join("x.png");
    let out = out.to_string_lossy();
    let scan = data("pump_room.e57");
    let scan = scan.to_string_lossy();
    let told = stdout(&surfel(&["info", &scan]));
    assert!(told.contains("  angular step 0.225") && told.contains("  scanner at   0.000000 0.000000"), "{told}");
    let json: serde_json::Value = serde_json::from_str(&stdout(&surfel(&["info", &scan, "--json"]))).unwrap();
    assert!((json["angular_step"].as_f64().unwrap() - 0.00393).abs() < 1e-5, "{json}");
    let small = ["-o", &out, "--size", "32x18", "--radius", "angle:auto"];
    let drawn = surfel(&[&["reference", &scan], &small[..]].concat());
    assert_eq!(drawn.status.code(), Some(0), "{}", stderr(&drawn));
    assert!(stdout(&drawn).contains("radii from the scanner's angular step of 0.00393"), "{}", stdout(&drawn));
    // A scene says neither, and a scanner's place is not enough.
    for more in [&[][..], &["--scanner", "0,0,9"]] {
        usage(
            &[&["reference", "scene:torus:99"], &small[..], more].concat(),
            "does not tell the scanner's angular step",
        );
    }
    fs::remove_dir_all(here).unwrap();
}

#[test]
fn outputs_are_tried_before_anything_is_read() {
    let here = folder("outputs");
    let nowhere = here.join("no/such/folder/x.png");
    refused(&["render", "scene:torus:99", "-o", &nowhere.to_string_lossy()], "no/such/folder/x.png");
    let fine = here.join("x.png");
    let fine = fine.to_string_lossy();
    refused(&["render", "scene:torus:99", "-o", &fine, "--stats", "/no/such/folder/s.json"], "s.json");
    let directory = here.join("d.png");
    fs::create_dir_all(&directory).unwrap();
    refused(&["render", "scene:torus:99", "-o", &directory.to_string_lossy()], "d.png");
    refused(&["render", "no such file.ply", "-o", &fine], "no such file.ply");
    let picture = here.join("same.png");
    fs::write(&picture, "not a scan").unwrap();
    let same = picture.to_string_lossy();
    assert!(refused(&["render", &same, "-o", &same], "same.png").contains("overwritten"));
    assert_eq!(fs::read_to_string(&picture).unwrap(), "not a scan");
    let left: Vec<_> = fs::read_dir(&here).unwrap().map(|e| e.unwrap().file_name()).collect();
    assert_eq!(left.len(), 2, "nothing else was left behind: {left:?}");
    fs::remove_dir_all(here).unwrap();
}

#[test]
fn with_data_info_tells_both_boxes_and_the_sphere() {
    let file = data("pond_mvs_normals.ply");
    let output = surfel(&["info", &file.to_string_lossy(), "--json"]);
    assert!(output.status.success(), "{}", stderr(&output));
    let v: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!((&v["points"], &v["points_in_file"]), (&70_051.into(), &70_051.into()));
    assert_eq!((&v["attributes"]["normals"], &v["attributes"]["radii"]), (&true.into(), &false.into()));
    let number = |v: &serde_json::Value| v.as_f64().unwrap();
    let mut half = 0.0;
    for axis in 0..3 {
        let [low, high] = ["min", "max"].map(|end| number(&v["box"][end][axis]));
        let [robust_low, robust_high] = ["min", "max"].map(|end| number(&v["robust_box"][end][axis]));
        assert!(low < robust_low && robust_low < robust_high && robust_high < high);
        half += (0.5 * (robust_high - robust_low)).powi(2);
        let center = number(&v["sphere"]["center"][axis]);
        assert!((center - 0.5 * (robust_low + robust_high)).abs() < 1e-6);
    }
    assert!((number(&v["sphere"]["radius"]) - half.sqrt()).abs() < 1e-6);
    let text = stdout(&surfel(&["info", &file.to_string_lossy()]));
    assert!(text.contains("70 051") && text.contains("robust box"));
}

#[test]
fn a_reader_that_goes_away_is_no_failure() {
    let mut child = Command::new(env!("CARGO_BIN_EXE_surfel"))
        .args(["info", "scene:torus:99"])
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    drop(child.stdout.take());
    let output = child.wait_with_output().unwrap();
    assert_eq!((output.status.code(), stderr(&output)), (Some(0), String::new()));
}

#[test]
fn with_data_broken_files_end_in_one_line_or_a_report() {
    let bad = data("bad/ply_zero_bytes.ply");
    let folder = bad.parent().unwrap();
    let mut seen = 0;
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        let output = surfel(&["info", &path.to_string_lossy(), "--json"]);
        match output.status.code() {
            Some(0) => {
                let v: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
                assert!(v["points"].as_u64() > Some(0), "{}", path.display());
            }
            Some(1) => {
                let text = stderr(&output);
                let name = path.file_name().unwrap().to_string_lossy();
                assert!(text.lines().count() == 1 && text.contains(&*name), "{text}");
            }
            other => panic!("{}: {other:?} {}", path.display(), stderr(&output)),
        }
        seen += 1;
    }
    assert!(seen >= 30, "{seen} files");
}

#[test]
fn pictures_are_compared() {
    let here = folder("compare");
    let path = |name: &str| here.join(name).to_string_lossy().into_owned();
    let (a, b, small) = (path("a.png"), path("b.png"), path("small.png"));
    let mut picture = image::RgbImage::from_fn(20, 15, |x, y| image::Rgb([(x * 9) as u8, (y * 11) as u8, 7]));
    picture.save(&a).unwrap();
    picture.get_pixel_mut(3, 4)[0] += 5;
    picture.save(&b).unwrap();
    image::RgbImage::new(2, 2).save(&small).unwrap();
    let json = |args: &[&str]| -> serde_json::Value {
        let output = surfel(&[&["compare", "--json"], args].concat());
        assert!(output.status.success(), "{}", stderr(&output));
        serde_json::from_slice(&output.stdout).unwrap()
    };
    let same = json(&[&a, &a]);
    assert_eq!((&same["equal"], &same["psnr"], &same["over"]), (&true.into(), &serde_json::Value::Null, &0.into()));
    let d = json(&[&a, &b]);
    assert_eq!((&d["equal"], &d["over"]), (&false.into(), &1.into()));
    // One of 900 values is off by 5 / 255.
    assert!((d["rmse"].as_f64().unwrap() - 5.0 / 255.0 / 30.0).abs() < 1e-12);
    assert_eq!(json(&[&a, &b, "--tolerance", "5"])["over"], 0);
    assert!(refused(&["compare", &a, &small], "small.png").contains("different sizes"));
    refused(&["compare", &a, &path("none.png")], "none.png");
    fs::write(path("text.png"), "no picture").unwrap();
    refused(&["compare", &a, &path("text.png")], "text.png");
    fs::remove_dir_all(here).unwrap();
}

#[test]
fn holes_depths_and_a_picture_of_the_error() {
    use surfel::exr::FloatPicture;
    let here = folder("compare-exr");
    let path = |name: &str| here.join(name).to_string_lossy().into_owned();
    let (a, b, png, out) = (path("a.exr"), path("b.exr"), path("b.png"), path("d.png"));
    let mut truth = FloatPicture {
        width: 16,
        height: 12,
        rgba: vec![[0.5, 0.25, 0.125, 1.0]; 16 * 12],
        coverage: true,
        depth: Some(vec![4.0; 16 * 12]),
        window: None,
    };
    // The left half is background.
    for i in (0..16 * 12).filter(|i| i % 16 < 8) {
        (truth.rgba[i], truth.depth.as_mut().unwrap()[i]) = ([0.0; 4], f32::INFINITY);
    }
    truth.write(&a).unwrap();
    let mut picture = truth.clone();
    let hole = 5 * 16 + 11;
    (picture.rgba[hole], picture.depth.as_mut().unwrap()[hole]) = ([0.0; 4], f32::INFINITY);
    picture.depth.as_mut().unwrap()[9] = 5.0;
    picture.write(&b).unwrap();
    let json = |args: &[&str]| -> serde_json::Value {
        let output = surfel(&[&["compare", "--json"], args].concat());
        assert!(output.status.success(), "{}", stderr(&output));
        serde_json::from_slice(&output.stdout).unwrap()
    };
    let same = json(&[&a, &a]);
    assert_eq!((&same["equal"], &same["flip"], &same["depth"]["max"]), (&true.into(), &0.0.into(), &0.0.into()));
    let d = json(&[&a, &b, "--difference", &out]);
    let found = ["holes", "holes_inside", "spill", "outline", "covered_truth", "interior"].map(|k| d[k].as_u64());
    // Of 8 × 12 covered pixels, 7 × 12 have no background beside them, and nine see the hole.
    assert_eq!(found, [1, 1, 0, 12, 96, 75].map(Some));
    assert_eq!((&d["rmse_interior"], &d["psnr_interior"]), (&0.0.into(), &serde_json::Value::Null));
    assert!((d["holes_share"].as_f64().unwrap() - 1.0 / 12.0).abs() < 1e-15);
    let depth = ["pixels", "only_truth", "only_picture"].map(|k| d["depth"][k].as_u64());
    assert_eq!((depth, d["depth"]["max"].as_f64()), ([95, 1, 0].map(Some), Some(0.25)));
    assert!(d["flip"].as_f64().unwrap() > 0.0);
    let map = image::open(&out).unwrap().to_rgb8();
    assert!(map.dimensions() == (16, 12) && map.get_pixel(11, 5) != map.get_pixel(0, 11));
    json(&[&a, &b, "--difference", &out, "--map", "absolute"]);
    let map = image::open(&out).unwrap().to_rgb8();
    let lit: Vec<_> = map.enumerate_pixels().filter(|p| p.2.0 != [0; 3]).map(|p| (p.0, p.1)).collect();
    assert_eq!(lit, [(11, 5)], "only the hole differs in colour");

    let mut farther = truth.clone();
    farther.depth.as_mut().unwrap()[9] = 4.5;
    farther.write(&b).unwrap();
    let d = json(&[&a, &b]);
    assert_eq!((&d["equal"], &d["rmse"]), (&false.into(), &0.0.into()), "the depth alone differs");
    picture.write(&b).unwrap();

    // The same picture in bytes, transparent where it is not covered: linear 0.5, 0.25, 0.125 is sRGB 188, 137, 99.
    let bytes = |i: u32| if i % 16 < 8 || i as usize == hole { [255, 0, 255, 0] } else { [188, 137, 99, 255] };
    image::RgbaImage::from_fn(16, 12, |x, y| image::Rgba(bytes(y * 16 + x))).save(&png).unwrap();
    let d = json(&[&b, &png, "--tolerance", "1"]);
    assert_eq!((&d["over"], &d["holes"], &d["depth"]), (&0.into(), &0.into(), &serde_json::Value::Null));
    let text = stdout(&surfel(&["compare", &a, &b]));
    for row in ["flip", "interior", "holes    1 pixels, 8.33 % of the outline; 1 inside", "spill", "depth"] {
        assert!(text.contains(row), "{row}: {text}");
    }

    let before = fs::read(&a).unwrap();
    let linked = path("linked.png");
    std::os::unix::fs::symlink(&png, &linked).unwrap();
    assert!(refused(&["compare", &a, &png, "--difference", &linked], "b.png").contains("overwritten"));
    usage(&["compare", &a, &b, "--difference", &a], ".png");
    usage(&["compare", &a, &b, "--background", "00000000"], "opaque");
    usage(&["compare", &a, &b, "--map", "flip"], "--difference");
    refused(&["compare", &a, &b, "--difference", &path("no/d.png")], "no/d.png");
    assert_eq!(fs::read(&a).unwrap(), before);
    fs::write(&b, &before[..before.len() / 2]).unwrap();
    refused(&["compare", &a, &b], "b.exr");
    fs::remove_dir_all(here).unwrap();
}

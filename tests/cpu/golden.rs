//! The f64 reference against its kept pictures, and that this comparison can fail.

use std::path::Path;

use surfel::readback::Picture;
use surfel::standalone::stress;

use crate::kept as golden;

fn write(folder: &Path, file: &str, width: u32, height: u32, rgb: &[u8]) {
    std::fs::create_dir_all(folder).expect("a folder");
    let path = folder.join(file).with_extension("png");
    image::save_buffer(&path, rgb, width, height, image::ExtendedColorType::Rgb8)
        .unwrap_or_else(|e| panic!("{}: {e}", path.display()));
}

/// As the device would hand it over.
fn reference(case: &stress::Case) -> Picture {
    let [width, height] = case.size;
    let rgba = stress::reference(case).expect("a picture").rgba.iter().map(|p| p.map(|v| v as f32)).collect();
    Picture { width, height, rgba, depth: None }
}

#[test]
fn the_reference_draws_what_it_drew() {
    for (case, file) in golden::cases() {
        let picture = reference(&case);
        let rgb = golden::encode(&picture);
        if std::env::var_os("SURFEL_BLESS").is_some_and(|v| v == "1") {
            write(&golden::folder(), file, picture.width, picture.height, &rgb);
        }
        golden::check(&golden::folder(), file, picture.width, picture.height, &rgb, 0).unwrap();
    }
}

/// Says what is wrong with `rgb` against the first kept picture.
fn fault(change: impl FnOnce(&mut Vec<u8>)) -> String {
    let (case, file) = golden::cases().swap_remove(0);
    let picture = reference(&case);
    let mut rgb = golden::encode(&picture);
    change(&mut rgb);
    golden::check(&golden::folder(), file, picture.width, picture.height, &rgb, 8).expect_err("it must fail")
}

#[test]
fn a_shifted_picture_fails() {
    assert!(fault(|rgb| rgb.rotate_right(3)).contains("off by more than a step"));
}

#[test]
fn swapped_channels_fail() {
    assert!(fault(|rgb| rgb.chunks_exact_mut(3).for_each(|p| p.swap(0, 2))).contains("off by more than a step"));
}

#[test]
fn an_offset_of_two_steps_fails() {
    assert!(fault(|rgb| rgb.iter_mut().for_each(|v| *v = v.saturating_sub(2))).contains("off by more than a step"));
}

#[test]
fn a_blank_pair_fails() {
    let folder = std::env::temp_dir().join(format!("surfel-golden-{}", std::process::id()));
    let blank = vec![7; 12];
    write(&folder, "blank", 2, 2, &blank);
    let said = golden::check(&folder, "blank", 2, 2, &blank, 0).expect_err("it must fail");
    std::fs::remove_dir_all(&folder).expect("its own folder");
    assert!(said.contains("blank"), "{said}");
}

#[test]
fn a_missing_golden_fails() {
    let said = golden::check(&golden::folder(), "never-made", 1, 1, &[0; 3], 0).expect_err("it must fail");
    assert!(said.contains("never-made.png") && said.contains("SURFEL_BLESS"), "{said}");
}

#[test]
fn another_size_fails() {
    let (_, file) = golden::cases().swap_remove(0);
    let said = golden::check(&golden::folder(), file, 2, 2, &[0; 12], 0).expect_err("it must fail");
    assert!(said.contains("sizes"), "{said}");
}

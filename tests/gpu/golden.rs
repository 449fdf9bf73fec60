//! The device against the kept pictures of the reference.

use surfel::standalone::stress;

use crate::kept as golden;
use crate::vulkan;

#[test]
fn the_device_draws_the_kept_pictures() {
    vulkan::draw([160, 112], true, |off| {
        for (case, file) in golden::cases() {
            let picture = stress::draw(off, &case).expect("a frame");
            let rgb = golden::encode(&picture);
            // Ties may be off: the reference counts as many as the case allows.
            golden::check(&golden::folder(), file, picture.width, picture.height, &rgb, case.off_ties as u64).unwrap();
        }
    });
}

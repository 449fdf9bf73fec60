//! What both test binaries share.

use std::path::PathBuf;

/// A file of the test data: in the folder that `SURFEL_DATA` names, else in `../shared/data` beside the package.
///
/// Tests that call this are named `with_data_…`: `./x test` leaves them out, and says so, on machines that have no such
/// folder; CI has it and leaves out nothing.
///
/// # Panics
/// If it is not there: a test without its data must not pass.
pub fn data(name: &str) -> PathBuf {
    let folder = match std::env::var_os("SURFEL_DATA") {
        Some(folder) => PathBuf::from(folder),
        None => PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../shared/data"),
    };
    let path = folder.join(name);
    assert!(path.is_file(), "test data is missing: {} (set SURFEL_DATA to the folder)", path.display());
    path
}

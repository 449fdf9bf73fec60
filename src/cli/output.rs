//! Files that appear whole or not at all, and that are known to be writable before the long work begins.

use std::fs::{self, File, OpenOptions};
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail};
use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use image::{ExtendedColorType, ImageEncoder};

use surfel::exr::FloatPicture;
use surfel::readback::{Picture, encode};
use surfel::reference;
use surfel::select::View;

use super::Usage;

/// A name beside `path` that nobody else uses.
fn beside(path: &Path) -> PathBuf {
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    path.with_file_name(format!(".{name}.{}.tmp", std::process::id()))
}

/// The folder, links resolved, and the name in it.
pub fn place(path: &Path) -> Option<(PathBuf, std::ffi::OsString)> {
    let folder = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
    Some((folder.canonicalize().ok()?, path.file_name()?.to_owned()))
}

/// Whether both names are of one file, links resolved; not where one of them is not there.
pub fn same(a: &Path, b: &Path) -> bool {
    matches!((a.canonicalize(), b.canonicalize()), (Ok(a), Ok(b)) if a == b)
}

/// Pipes and devices are written straight: they cannot be replaced.
fn special(path: &Path) -> bool {
    fs::metadata(path).is_ok_and(|about| !about.is_file() && !about.is_dir())
}

/// Fails, naming the file and the reason, where `path` could not be written later.
pub fn check(path: &Path) -> Result<()> {
    let name = || path.display().to_string();
    if path.file_name().is_none() || path.is_dir() {
        bail!("{}: cannot be written: it is a directory", path.display());
    }
    // Opening a pipe would wait for its reader.
    if path.exists() && !special(path) {
        OpenOptions::new().write(true).open(path).with_context(|| format!("{}: cannot be written", name()))?;
    }
    if !special(path) {
        let trial = beside(path);
        File::create(&trial).with_context(|| format!("{}: cannot be written", name()))?;
        // It is empty and ours; a folder that keeps it does no harm.
        let _ = fs::remove_file(&trial);
    }
    Ok(())
}

/// Writes a file through one with another name, so that nobody ever sees half of it.
pub fn write(path: &Path, fill: impl FnOnce(&mut dyn Write) -> Result<()>) -> Result<()> {
    let fill = |target: &Path| -> Result<()> {
        let mut out = BufWriter::new(File::create(target)?);
        fill(&mut out)?;
        out.flush()?;
        Ok(())
    };
    if special(path) {
        return fill(path).with_context(|| format!("{}: cannot be written", path.display()));
    }
    let trial = beside(path);
    let done = fill(&trial).and_then(|()| Ok(fs::rename(&trial, path)?));
    if done.is_err() {
        // The first error is the one to tell.
        let _ = fs::remove_file(&trial);
    }
    done.with_context(|| format!("{}: cannot be written", path.display()))
}

/// Whether the picture is written in float, with its depth; another ending than these two would lie.
pub fn is_float(path: &Path) -> Result<bool> {
    let ends = |with: &str| path.extension().is_some_and(|e| e.eq_ignore_ascii_case(with));
    if !ends("png") && !ends("exr") {
        let text =
            format!("{}: the picture's name must end in .png or .exr, the formats that are written", path.display());
        return Err(Usage(text).into());
    }
    Ok(ends("exr"))
}

/// A picture as the device left it, with linear depth.
pub fn float(picture: Picture, view: &View) -> FloatPicture {
    let Picture { width, height, rgba, depth } = picture;
    let view = view.right_handed();
    let linear = |z: f32| if z as f64 == view.depth.far() { f32::INFINITY } else { view.linear_depth(z as f64) as f32 };
    let depth = depth.map(|d| d.into_iter().map(linear).collect());
    FloatPicture { width, height, rgba, coverage: true, depth, window: window(&view, [width, height]) }
}

/// A picture of the reference.
pub fn from_reference(picture: &reference::Picture, view: &View) -> FloatPicture {
    let (width, height) = (picture.width, picture.height);
    FloatPicture {
        width,
        height,
        rgba: picture.rgba.iter().map(|p| p.map(|v| v as f32)).collect(),
        coverage: true,
        depth: Some(picture.depth.iter().map(|&z| z as f32).collect()),
        window: window(view, [width, height]),
    }
}

/// For [`FloatPicture::window`].
fn window(view: &View, [width, height]: [u32; 2]) -> Option<f32> {
    view.is_perspective().then(|| (width as f64 / view.focal(height as f64)) as f32)
}

/// Writes a picture in the format of the name: PNG over the background, EXR as it is.
pub fn picture(path: &Path, picture: &FloatPicture, background: [u8; 4]) -> Result<()> {
    let FloatPicture { width, height, rgba, .. } = picture;
    if is_float(path)? {
        let bytes = picture.to_bytes(path)?;
        return write(path, |out| Ok(out.write_all(&bytes)?));
    }
    png(path, *width, *height, &encode(rgba, background))
}

/// Writes RGBA rows from the top; without alpha where every pixel is opaque, which more programs show as it is.
pub fn png(path: &Path, width: u32, height: u32, rgba: &[u8]) -> Result<()> {
    let opaque = rgba.chunks_exact(4).all(|p| p[3] == 255);
    write(path, |out| {
        let encoder = PngEncoder::new_with_quality(out, CompressionType::Fast, FilterType::Adaptive);
        if opaque {
            let rgb: Vec<u8> = rgba.chunks_exact(4).flat_map(|p| [p[0], p[1], p[2]]).collect();
            encoder.write_image(&rgb, width, height, ExtendedColorType::Rgb8)?;
        } else {
            encoder.write_image(rgba, width, height, ExtendedColorType::Rgba8)?;
        }
        Ok(())
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_and_folders() {
        assert!(!is_float(Path::new("a/b.PNG")).unwrap() && is_float(Path::new("b.exr")).unwrap());
        for bad in ["a.jpg", "png", ".png", "a.png/"] {
            let refused = is_float(Path::new(bad)).is_err();
            assert!(refused || bad == "a.png/", "{bad}");
        }
        let folder = std::env::temp_dir();
        assert!(check(&folder).is_err());
        assert!(check(&folder.join("no such folder").join("a.png")).is_err());
    }

    #[test]
    fn half_a_file_is_never_seen() {
        let path = std::env::temp_dir().join(format!("surfel-output-{}.txt", std::process::id()));
        write(&path, |out| Ok(out.write_all(b"one")?)).unwrap();
        let failed = write(&path, |out| {
            out.write_all(b"half")?;
            bail!("stopped")
        });
        assert!(failed.is_err());
        assert_eq!(fs::read(&path).unwrap(), b"one");
        assert!(!beside(&path).exists());
        fs::remove_file(&path).unwrap();
    }
}

//! A file on this machine.

use std::fs::{File, Metadata};
use std::io::ErrorKind;
use std::os::unix::fs::{FileExt, MetadataExt};
use std::path::Path;

use super::{Access, Fault, FaultKind};
use crate::error::{Error, Result};

/// Reads by position, without a map: a file that is cut short under a map would end the process.
#[derive(Debug)]
pub struct FileAccess {
    file: File,
    name: String,
    size: u64,
    stamp: [i64; 4],
}

/// Changes when a file is written to.
fn stamp(of: &Metadata) -> [i64; 4] {
    [of.mtime(), of.mtime_nsec(), of.size() as i64, of.ino() as i64]
}

impl FileAccess {
    /// Opens a file. One that is replaced later (a new file under the old name) is still the one that was opened.
    ///
    /// # Errors
    /// [`Error::Io`]; what is no regular file (a folder, a pipe) is `InvalidInput`.
    pub fn open(path: impl AsRef<Path>) -> Result<FileAccess> {
        let path = path.as_ref();
        // Asked first: opening a pipe would wait for whoever writes to it.
        let regular = |m: Metadata| m.is_file().then_some(()).ok_or_else(|| ErrorKind::InvalidInput.into());
        let opened = std::fs::metadata(path).and_then(regular).and_then(|()| File::open(path));
        let opened = opened.and_then(|file| file.metadata().map(|m| (file, m)));
        let (file, metadata) = opened.map_err(|e| Error::io(path, e))?;
        let (name, size) = (path.display().to_string(), metadata.len());
        Ok(FileAccess { file, name, size, stamp: stamp(&metadata) })
    }

    fn fault(&self, kind: FaultKind, at: u64, why: String) -> Fault {
        Fault { kind, name: self.name.clone(), at, why }
    }
}

impl Access for FileAccess {
    fn name(&self) -> &str {
        &self.name
    }

    fn size(&self) -> u64 {
        self.size
    }

    fn read(&self, at: u64, to: &mut [u8]) -> std::result::Result<(), Fault> {
        let refused = |e: std::io::Error| self.fault(FaultKind::Io, at, e.to_string());
        let beyond = at.checked_add(to.len() as u64).is_none_or(|end| end > self.size);
        let read = if beyond { Err(ErrorKind::UnexpectedEof.into()) } else { self.file.read_exact_at(to, at) };
        if stamp(&self.file.metadata().map_err(refused)?) != self.stamp {
            return Err(self.fault(FaultKind::Changed, at, "the file was altered after it was opened".into()));
        }
        match read {
            Err(e) if e.kind() == ErrorKind::UnexpectedEof => {
                let why = format!("{} bytes were asked for, the file has {} in all", to.len(), self.size);
                Err(self.fault(FaultKind::Short, at, why))
            }
            read => read.map_err(refused),
        }
    }
}

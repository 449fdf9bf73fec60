//! Temporary files of records, beside the output. A name exists only until the file is open: whatever ends the process,
//! nothing is left of them.

use std::fs::{File, OpenOptions};
use std::io::{BufWriter, Write};
use std::os::unix::fs::FileExt;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering};

use bytemuck::Pod;

use crate::error::{Error, Result};

/// Bytes that are read or written at a time.
pub(super) const BUFFER: usize = 1 << 20;

/// Where temporary files are made.
#[derive(Debug)]
pub(super) struct Folder {
    output: PathBuf,
    made: AtomicU32,
}

fn beside(output: &Path, what: &str) -> PathBuf {
    let mut name = output.as_os_str().to_owned();
    name.push(format!(".{}{what}.part", std::process::id()));
    name.into()
}

impl Folder {
    /// Beside this file. What a build that was killed has left there under its name is removed.
    pub fn new(output: &Path) -> Arc<Folder> {
        let start = output.file_name().map(|n| format!("{}.", n.to_string_lossy())).unwrap_or_default();
        let folder = output.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
        // A folder that cannot be listed is told when a file is made in it.
        for entry in std::fs::read_dir(folder).into_iter().flatten().flatten() {
            let name = entry.file_name().to_string_lossy().into_owned();
            let of = name.strip_prefix(&start).and_then(|n| n.strip_suffix(".part"));
            let process = of.and_then(|n| n.split('-').next()).and_then(|n| n.parse::<u32>().ok());
            if process.is_some_and(|p| p != std::process::id() && !Path::new(&format!("/proc/{p}")).exists()) {
                // Another build may have been faster.
                let _ = std::fs::remove_file(entry.path());
            }
        }
        Arc::new(Folder { output: output.to_owned(), made: AtomicU32::new(0) })
    }

    /// Errors of temporary files name the output, which is what lies on the disk that is full.
    pub fn fails(&self, e: std::io::Error) -> Error {
        Error::io(&self.output, e)
    }

    /// The name that a whole file is written under before it gets its own.
    pub fn whole(&self) -> PathBuf {
        beside(&self.output, "")
    }

    fn file(&self) -> Result<File> {
        let number = self.made.fetch_add(1, Ordering::Relaxed);
        let path = beside(&self.output, &format!("-{number}"));
        let open = OpenOptions::new().read(true).write(true).create(true).truncate(true).open(&path);
        let file = open.map_err(|e| self.fails(e))?;
        std::fs::remove_file(&path).map_err(|e| self.fails(e))?;
        Ok(file)
    }

    /// An empty file of records.
    pub fn writer<T: Pod>(self: &Arc<Self>) -> Result<Writer<T>> {
        let to = BufWriter::with_capacity(BUFFER, self.file()?);
        Ok(Writer { folder: self.clone(), to, count: 0, of: std::marker::PhantomData })
    }
}

/// Appends records.
pub(super) struct Writer<T> {
    folder: Arc<Folder>,
    to: BufWriter<File>,
    count: u64,
    of: std::marker::PhantomData<T>,
}

impl<T: Pod> Writer<T> {
    pub fn push(&mut self, records: &[T]) -> Result<()> {
        self.to.write_all(bytemuck::cast_slice(records)).map_err(|e| self.folder.fails(e))?;
        self.count += records.len() as u64;
        Ok(())
    }

    pub fn count(&self) -> u64 {
        self.count
    }

    pub fn finish(self) -> Result<Spool<T>> {
        let Writer { folder, to, count, of } = self;
        let file = to.into_inner().map_err(|e| folder.fails(e.into_error()))?;
        Ok(Spool { folder, file, count, of })
    }
}

/// Records that were written. Freed when dropped.
pub(super) struct Spool<T> {
    folder: Arc<Folder>,
    file: File,
    count: u64,
    of: std::marker::PhantomData<T>,
}

impl<T: Pod> Spool<T> {
    pub fn count(&self) -> u64 {
        self.count
    }

    /// Fills `to` with the records from `first` on.
    pub fn read(&self, first: u64, to: &mut [T]) -> Result<()> {
        let bytes: &mut [u8] = bytemuck::cast_slice_mut(to);
        self.file.read_exact_at(bytes, first * size_of::<T>() as u64).map_err(|e| self.folder.fails(e))
    }

    /// All of them, in memory.
    pub fn load(&self) -> Result<Vec<T>> {
        let mut all = Vec::new();
        self.load_to(&mut all).map(|()| all)
    }

    /// All of them, in place of what `to` has.
    pub fn load_to(&self, to: &mut Vec<T>) -> Result<()> {
        to.resize(self.count as usize, T::zeroed());
        self.read(0, to)
    }

    /// Puts records where there may be others, from `first` on. A file grows as needed.
    pub fn put(&self, first: u64, records: &[T]) -> Result<()> {
        let bytes: &[u8] = bytemuck::cast_slice(records);
        self.file.write_all_at(bytes, first * size_of::<T>() as u64).map_err(|e| self.folder.fails(e))
    }

    /// Calls `f(number of the first, records)` for all, a block after the other; the next is read meanwhile.
    pub fn each(&self, mut f: impl FnMut(u64, &[T]) -> Result<()> + Send) -> Result<()>
    where
        T: Send + Sync,
    {
        let all = self.count;
        let room = (BUFFER / size_of::<T>()) as u64;
        let block = |first: u64| -> Result<Vec<T>> {
            let mut records = bytemuck::zeroed_vec((all - first).min(room) as usize);
            self.read(first, &mut records).map(|()| records)
        };
        let mut first = 0;
        let mut ready = block(0)?;
        while first < all {
            let next = (first + room).min(all);
            let (done, read) = rayon::join(|| f(first, &ready), || block(next));
            done?;
            (first, ready) = (next, read?);
        }
        Ok(())
    }
}

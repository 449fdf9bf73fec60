//! The lowest layer of a file: pages of 1020 bytes, each with its checksum behind it.
//!
//! A *physical* offset counts the checksums, a *logical* one does not. A page is checked when something in it is wanted,
//! so damage in an embedded picture does not keep the points from being read.

use std::io::{Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

use crate::error::{Error, Place, Result};

/// Bytes of a page with its checksum; the standard knows no other.
pub(super) const PAGE: u64 = 1024;
/// Bytes of a page that count.
const CONTENT: u64 = PAGE - 4;
/// Pages that are read at once.
const AT_ONCE: u64 = 64;

/// What a file says of itself before anything else.
pub(super) struct Header {
    /// Physical offset and logical length of the description.
    pub(super) xml: (u64, u64),
}

pub(super) struct Pages<S> {
    file: PathBuf,
    source: S,
    /// Whole pages in the file.
    count: u64,
    /// Logical offset of what is read next.
    at: u64,
    /// Pages as they are in the file, from page `first` on.
    buffer: Vec<u8>,
    first: u64,
    /// The page whose checksum was compared last.
    checked: Option<u64>,
}

impl<S: Read + Seek> Pages<S> {
    /// Reads the header and compares it with the file.
    pub(super) fn open(file: &Path, mut source: S) -> Result<(Header, Pages<S>)> {
        let io = |e| Error::io(file, e);
        let size = source.seek(SeekFrom::End(0)).map_err(io)?;
        source.rewind().map_err(io)?;
        let mut head = [0; 48];
        if size < head.len() as u64 {
            return Err(Error::data(file, Place::Byte(size), "the file ends inside its header"));
        }
        source.read_exact(&mut head).map_err(io)?;
        let half = |at: usize| u32::from_le_bytes([head[at], head[at + 1], head[at + 2], head[at + 3]]);
        let word = |at: usize| u64::from(half(at)) | u64::from(half(at + 4)) << 32;
        let fail = |at: u64, why: String| Err(Error::data(file, Place::Byte(at), why));
        if (half(8), half(12)) != (1, 0) {
            return fail(8, format!("E57 version {}.{} is not known", half(8), half(12)));
        }
        if word(40) != PAGE {
            return fail(40, format!("pages of {} bytes; E57 has pages of {PAGE}", word(40)));
        }
        if word(16) > size {
            return fail(size, format!("the file ends here; its header promises {} bytes", word(16)));
        }
        if !size.is_multiple_of(PAGE) {
            return fail(size, format!("the file ends inside a page of {PAGE} bytes"));
        }
        let xml = (word(24), word(32));
        let count = size / PAGE;
        let pages = Pages { file: file.to_owned(), source, count, at: 0, buffer: Vec::new(), first: 0, checked: None };
        Ok((Header { xml }, pages))
    }

    pub(super) fn file(&self) -> &Path {
        &self.file
    }

    /// What the pages are read from.
    pub(super) fn source(&mut self) -> &mut S {
        &mut self.source
    }

    /// Bytes in all pages without their checksums.
    pub(super) fn len(&self) -> u64 {
        self.count * CONTENT
    }

    /// Logical offset of what is read next.
    pub(super) fn at(&self) -> u64 {
        self.at
    }

    /// Where a logical offset is in the file, for errors.
    pub(super) fn place(at: u64) -> Place {
        Place::Byte(at / CONTENT * PAGE + at % CONTENT)
    }

    pub(super) fn seek(&mut self, logical: u64) {
        self.at = logical;
    }

    /// Goes to a physical offset that the file gives; `what` is to be there.
    pub(super) fn seek_physical(&mut self, physical: u64, what: &str) -> Result<()> {
        let (page, rest) = (physical / PAGE, physical % PAGE);
        if page >= self.count || rest >= CONTENT {
            let why = format!("{what} is said to be at byte {physical}, where nothing can be");
            return Err(Error::data(&self.file, Place::File, why));
        }
        self.at = page * CONTENT + rest;
        Ok(())
    }

    /// Fills `out` from where it is.
    pub(super) fn read(&mut self, mut out: &mut [u8]) -> Result<()> {
        while !out.is_empty() {
            let (page, from) = (self.at / CONTENT, (self.at % CONTENT) as usize);
            let content = self.page(page)?;
            let n = out.len().min(content.len() - from);
            out[..n].copy_from_slice(&content[from..from + n]);
            out = &mut out[n..];
            self.at += n as u64;
        }
        Ok(())
    }

    /// The content of a page whose checksum is right.
    fn page(&mut self, page: u64) -> Result<&[u8]> {
        if page >= self.count {
            let end = Place::Byte(self.count * PAGE);
            return Err(Error::data(&self.file, end, "the file ends inside its points or its description"));
        }
        let there = self.buffer.len() as u64 / PAGE;
        if page < self.first || page >= self.first + there {
            self.buffer.resize((AT_ONCE.min(self.count - page) * PAGE) as usize, 0);
            // Nothing is there should the reading fail.
            self.first = u64::MAX - AT_ONCE;
            self.checked = None;
            let read = self.source.seek(SeekFrom::Start(page * PAGE)).map(|_| ());
            read.and_then(|()| self.source.read_exact(&mut self.buffer)).map_err(|e| Error::io(&self.file, e))?;
            self.first = page;
        }
        let from = ((page - self.first) * PAGE) as usize;
        let (content, sum) = self.buffer[from..from + PAGE as usize].split_at(CONTENT as usize);
        if self.checked != Some(page) {
            // The only number of the format that is big-endian.
            if sum != crc(content).to_be_bytes() {
                let why = format!("the checksum of page {page} is wrong: the file is damaged here");
                return Err(Error::data(&self.file, Place::Byte(page * PAGE), why));
            }
            self.checked = Some(page);
        }
        Ok(content)
    }
}

/// CRC-32C (Castagnoli), eight bits at a time.
fn crc(bytes: &[u8]) -> u32 {
    const TABLE: [u32; 256] = {
        let mut table = [0; 256];
        let mut i = 0;
        while i < 256 {
            let mut v = i as u32;
            let mut bit = 0;
            while bit < 8 {
                v = if v & 1 == 1 { v >> 1 ^ 0x82f6_3b78 } else { v >> 1 };
                bit += 1;
            }
            table[i] = v;
            i += 1;
        }
        table
    };
    !bytes.iter().fold(!0, |sum: u32, b| TABLE[((sum ^ u32::from(*b)) & 0xff) as usize] ^ sum >> 8)
}

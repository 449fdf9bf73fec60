//! What can go wrong that the caller could not foresee. Misuse is not here: it is a documented precondition.

use std::fmt;
use std::path::{Path, PathBuf};

use ash::vk;

/// The library's result.
pub type Result<T, E = Error> = std::result::Result<T, E>;

/// Where in a file something is wrong.
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub enum Place {
    /// The file as a whole.
    File,
    /// Byte offset from the start of the file.
    Byte(u64),
    /// Line of a text file or text header, from 1.
    Line(u64),
    /// Named element (`vertex`, `face`, `point`) and its index, from 0.
    Element(&'static str, u64),
}

impl fmt::Display for Place {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Place::File => Ok(()),
            Place::Byte(at) => write!(f, " at byte {at}"),
            Place::Line(line) => write!(f, " in line {line}"),
            Place::Element(what, index) => write!(f, " in {what} {index}"),
        }
    }
}

/// Everything that the library reports.
#[derive(Debug)]
#[non_exhaustive]
pub enum Error {
    /// The file's content cannot be used: who, where, why.
    Data {
        /// The file, or a name for bytes that come from elsewhere.
        file: PathBuf,
        /// Where in it.
        place: Place,
        /// Why, in one line without the file's name.
        why: String,
    },
    /// The system refused to open, read or write a file.
    Io {
        /// The file.
        file: PathBuf,
        /// The system's reason.
        source: std::io::Error,
    },
    /// The device or the host's set-up cannot do what was asked.
    Unsupported(String),
    /// The device has not enough memory.
    OutOfDeviceMemory {
        /// What it was for.
        what: String,
        /// Bytes asked for.
        requested: u64,
    },
    /// The device was lost; destroy everything and start again.
    DeviceLost,
    /// Bytes of a streamed model did not come.
    Stream(crate::stream::Fault),
    /// Any other refusal of the driver.
    Vulkan {
        /// The call.
        call: &'static str,
        /// Its result code.
        result: vk::Result,
    },
}

impl Error {
    pub(crate) fn data(file: impl AsRef<Path>, place: Place, why: impl Into<String>) -> Self {
        Error::Data { file: file.as_ref().to_owned(), place, why: why.into() }
    }

    pub(crate) fn io(file: impl AsRef<Path>, source: std::io::Error) -> Self {
        Error::Io { file: file.as_ref().to_owned(), source }
    }

    /// `call` returned `result`.
    pub(crate) fn vulkan(call: &'static str, result: vk::Result) -> Self {
        match result {
            vk::Result::ERROR_DEVICE_LOST => Error::DeviceLost,
            vk::Result::ERROR_OUT_OF_DEVICE_MEMORY | vk::Result::ERROR_OUT_OF_HOST_MEMORY => {
                Error::OutOfDeviceMemory { what: call.to_owned(), requested: 0 }
            }
            _ => Error::Vulkan { call, result },
        }
    }
}

impl fmt::Display for Error {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Error::Data { file, place, why } => write!(f, "{}{place}: {why}", file.display()),
            Error::Io { file, source } => write!(f, "{}: {source}", file.display()),
            Error::Unsupported(what) => write!(f, "not supported: {what}"),
            Error::OutOfDeviceMemory { what, requested: 0 } => write!(f, "out of device memory: {what}"),
            Error::OutOfDeviceMemory { what, requested } => {
                write!(f, "out of device memory: {what} needs {requested} bytes")
            }
            Error::DeviceLost => write!(f, "the device was lost"),
            Error::Stream(fault) => write!(f, "{fault}"),
            Error::Vulkan { call, result } => write!(f, "{call}: {result}"),
        }
    }
}

impl std::error::Error for Error {
    fn source(&self) -> Option<&(dyn std::error::Error + 'static)> {
        match self {
            Error::Io { source, .. } => Some(source),
            Error::Stream(fault) => Some(fault),
            Error::Vulkan { result, .. } => Some(result),
            _ => None,
        }
    }
}

/// Names the call in an error: `device.create_fence(..).named("vkCreateFence")?`.
pub(crate) trait Named<T> {
    fn named(self, call: &'static str) -> Result<T>;
}

impl<T> Named<T> for ash::prelude::VkResult<T> {
    fn named(self, call: &'static str) -> Result<T> {
        self.map_err(|result| Error::vulkan(call, result))
    }
}

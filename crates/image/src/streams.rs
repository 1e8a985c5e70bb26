//! Files as trait objects: codecs are compiled once, in this crate, and not again for each kind of file in each crate that reads or writes one.

use std::io::{Read, Seek, Write};

/// What can be read anywhere.
pub(crate) trait ReadSeek: Read + Seek {}

impl<T: Read + Seek + ?Sized> ReadSeek for T {}

/// What can be written anywhere.
pub(crate) trait WriteSeek: Write + Seek {}

impl<T: Write + Seek + ?Sized> WriteSeek for T {}

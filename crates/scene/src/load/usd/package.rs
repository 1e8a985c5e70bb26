//! Packages: `.usdz`, files stored one after the other in a zip archive without compression.
//!
//! Source: PKWARE, "APPNOTE.TXT: .ZIP file format specification" 6.3, §4.3; OpenUSD, "Usdz file format specification".

use super::error;
use crate::SceneError;
use std::collections::HashMap;
use std::ops::Range;
use std::sync::Arc;

/// How a zip archive begins.
pub const MAGIC: &[u8] = b"PK\x03\x04";

/// Files by name.
#[derive(Debug)]
pub struct Package {
    pub name: String,
    pub bytes: Arc<[u8]>,
    pub files: HashMap<String, Range<usize>>,
    /// The first one: the scene.
    pub first: Option<String>,
}

/// Reads the directory of an archive. Fails where it is cut short, a file in it is compressed, or an entry lies outside of it.
pub fn read(bytes: Arc<[u8]>, name: &str) -> Result<Package, SceneError> {
    let damaged = |found: &str| error(name, found, "a whole .usdz file: it is cut short or damaged");
    let short = |at: usize| bytes.get(at..at.checked_add(2)?).map(|b| usize::from(u16::from_le_bytes([b[0], b[1]])));
    let long = |at: usize| bytes.get(at..at.checked_add(4)?).map(|b| u32::from_le_bytes([b[0], b[1], b[2], b[3]]) as usize);
    // The end record, behind which a comment may stand.
    let last = bytes.len().saturating_sub(22);
    let end = (last.saturating_sub(65_535)..=last).rev().find(|at| bytes[*at..].starts_with(b"PK\x05\x06"));
    let end = end.ok_or_else(|| damaged("an archive without a directory"))?;
    let (count, mut at) = short(end + 10).zip(long(end + 16)).ok_or_else(|| damaged("a directory that is cut short"))?;
    let mut files: HashMap<String, Range<usize>> = HashMap::new();
    let mut first: Option<(usize, String)> = None;
    for _ in 0..count {
        let entry = || {
            if !bytes.get(at..)?.starts_with(b"PK\x01\x02") {
                return None;
            }
            let (method, size) = (short(at + 10)?, long(at + 20)?);
            let (name, extra, comment, local) = (short(at + 28)?, short(at + 30)?, short(at + 32)?, long(at + 42)?);
            let file = String::from_utf8_lossy(bytes.get(at + 46..at + 46 + name)?).into_owned();
            // The local header has lengths of its own.
            let start = local + 30 + short(local + 26)? + short(local + 28)?;
            bytes.get(start..start.checked_add(size)?)?;
            Some((method, file, local, start..start + size, 46 + name + extra + comment))
        };
        let (method, file, local, range, length) = entry().ok_or_else(|| damaged("an entry outside of the archive"))?;
        if method != 0 {
            let expected = "stored files, as .usdz has them: usdzip packs the scene again";
            return Err(error(name, format!("\"{file}\" is compressed"), expected));
        }
        if first.as_ref().is_none_or(|(place, _)| local < *place) {
            first = Some((local, file.clone()));
        }
        files.insert(file, range);
        at += length;
    }
    Ok(Package { name: name.to_owned(), files, first: first.map(|f| f.1), bytes })
}

#[cfg(test)]
pub mod tests {
    use super::*;

    /// An archive of stored files.
    pub fn archive(files: &[(&str, &[u8])]) -> Vec<u8> {
        let (mut out, mut directory) = (Vec::new(), Vec::new());
        for (name, data) in files {
            let local = out.len() as u32;
            let size = (data.len() as u32).to_le_bytes();
            let lengths = [(name.len() as u16).to_le_bytes(), [0; 2]].concat();
            let common = [&[10, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0][..], &size, &size, &lengths].concat();
            out.extend([&b"PK\x03\x04"[..], &common, name.as_bytes(), data].concat());
            directory.extend([&b"PK\x01\x02\x0a\0"[..], &common, &[0; 10], &local.to_le_bytes(), name.as_bytes()].concat());
        }
        let (start, n) = ((out.len() as u32).to_le_bytes(), (files.len() as u16).to_le_bytes());
        let size = (directory.len() as u32).to_le_bytes();
        out.extend(directory);
        out.extend([&b"PK\x05\x06\0\0\0\0"[..], &n, &n, &size, &start, &[0, 0]].concat());
        out
    }

    #[test]
    fn stored_files_are_found_and_damaged_archives_refused() {
        let whole = archive(&[("a.usda", b"hello"), ("t/b.png", b"picture")]);
        let package = read(whole.clone().into(), "a.usdz").unwrap();
        assert_eq!(&package.bytes[package.files["t/b.png"].clone()], b"picture");
        assert_eq!(package.first.as_deref(), Some("a.usda"));
        for cut in 0..whole.len() {
            assert!(read(whole[..cut].into(), "a.usdz").is_err(), "{cut}");
        }
        for i in 0..whole.len() {
            let mut changed = whole.clone();
            changed[i] = 0xff;
            let _ = read(changed.into(), "a.usdz");
        }
        let mut packed = whole.clone();
        let at = packed.windows(4).position(|w| w == b"PK\x01\x02").unwrap();
        packed[at + 10] = 8;
        assert!(read(packed.into(), "a.usdz").unwrap_err().to_string().contains("compressed"));
    }
}

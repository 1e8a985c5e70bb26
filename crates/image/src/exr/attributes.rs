//! The order of the attributes in the header of an EXR file.
//!
//! The format leaves it open, and the library that writes them takes them from a hash map: two files of the same picture then differ in it. Source:
//! "OpenEXR File Layout" (Academy Software Foundation), sections "Header" and "Attribute Layout".

use crate::ImageError;
use std::io::{Read, Seek, SeekFrom, Write};

/// Magic number and version.
const BEGIN: usize = 8;
/// Bytes in which a header is looked for at first.
const FIRST_READ: u64 = 1 << 16;
/// Bit of the version field of files with several parts.
const MULTIPART: u8 = 0x10;

/// Puts the attributes of each part of a file into the order of their names: the same picture is then the same bytes. Nothing else moves. Fails on
/// what does not begin as an EXR file, and on a header that is cut off.
pub fn sort_attributes(file: &mut [u8]) -> Result<(), ImageError> {
    let wrong = |reason: &str| ImageError::Malformed { format: "EXR", reason: reason.to_owned() };
    let flags = file.get(5).copied().filter(|_| file[..4] == [0x76, 0x2f, 0x31, 0x01]);
    let Some(flags) = flags else { return Err(wrong("not a file whose attributes can be sorted")) };
    let mut at = BEGIN;
    loop {
        let end = sort_header(file, at)?;
        // One header follows the other; behind the last of several parts stands an empty one.
        if flags & MULTIPART == 0 || end == at {
            return Ok(());
        }
        at = end + 1;
    }
}

/// Sorts the header that begins at a place; where its end mark stands.
fn sort_header(file: &mut [u8], begin: usize) -> Result<usize, ImageError> {
    let cut = || ImageError::Malformed { format: "EXR", reason: "its header is cut off".to_owned() };
    let mut attributes: Vec<(Vec<u8>, Vec<u8>)> = Vec::new();
    let mut at = begin;
    // Name and type end with a zero byte, the size of the value has four; an empty name ends the header.
    let text_end =
        |from: usize| file.get(from..).and_then(|rest| rest.iter().position(|b| *b == 0)).map(|n| from + n).ok_or_else(cut);
    loop {
        let name_end = text_end(at)?;
        if name_end == at {
            break;
        }
        let size_at = text_end(name_end + 1)? + 1;
        let size = file.get(size_at..size_at + 4).and_then(|s| Some(u32::from_le_bytes(s.try_into().ok()?))).ok_or_else(cut)?;
        let end = size_at + 4 + size as usize;
        let whole = file.get(at..end).ok_or_else(cut)?;
        attributes.push((file[at..name_end].to_vec(), whole.to_vec()));
        at = end;
    }
    attributes.sort();
    let sorted: Vec<u8> = attributes.into_iter().flat_map(|a| a.1).collect();
    file[begin..at].copy_from_slice(&sorted);
    Ok(at)
}

/// The same in a file that is open for reading and writing, of which only the header is read. Fails as that does, or where the file does.
pub fn sort_attributes_in(file: &mut (impl Read + Write + Seek)) -> Result<(), ImageError> {
    let length = file.seek(SeekFrom::End(0))?;
    let mut read = FIRST_READ;
    loop {
        file.seek(SeekFrom::Start(0))?;
        let mut header = Vec::new();
        Read::take(&mut *file, read).read_to_end(&mut header)?;
        match sort_attributes(&mut header) {
            // The header may be longer: names of many objects.
            Err(_) if read < length => read *= 8,
            sorted => {
                sorted?;
                file.seek(SeekFrom::Start(0))?;
                return Ok(file.write_all(&header)?);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ExposureFacts;
    use crate::exr::{read_plane, write_planes};
    use std::io::Cursor;

    /// A file with these attributes, and something behind them.
    fn file(attributes: &[(&str, &[u8])]) -> Vec<u8> {
        let mut bytes = vec![0x76, 0x2f, 0x31, 0x01, 2, 0, 0, 0];
        for (name, value) in attributes {
            bytes.extend([name.as_bytes(), b"\0string\0", &(value.len() as u32).to_le_bytes(), value].concat());
        }
        bytes.extend(b"\0behind");
        bytes
    }

    #[test]
    fn attributes_stand_in_the_order_of_their_names() {
        let mut mixed = file(&[("b", b"second\0"), ("ab", b""), ("a", b"first")]);
        sort_attributes(&mut mixed).unwrap();
        assert_eq!(mixed, file(&[("a", b"first"), ("ab", b""), ("b", b"second\0")]));
        let mut cut = file(&[("a", b"first")]);
        cut.truncate(20);
        assert!(sort_attributes(&mut cut).is_err() && sort_attributes(&mut b"no EXR at all".to_vec()).is_err());
    }

    #[test]
    fn each_part_is_sorted_by_itself() {
        let parts = |of_first: &[(&str, &[u8])], of_second: &[(&str, &[u8])]| {
            let header = |attributes: &[(&str, &[u8])]| file(attributes)[BEGIN..].strip_suffix(b"behind").unwrap().to_vec();
            let mut bytes = vec![0x76, 0x2f, 0x31, 0x01, 2, MULTIPART, 0, 0];
            bytes.extend([header(of_first), header(of_second), b"\0behind".to_vec()].concat());
            bytes
        };
        let mut mixed = parts(&[("b", b"1"), ("a", b"2")], &[("d", b"3"), ("c", b"")]);
        sort_attributes(&mut mixed).unwrap();
        assert_eq!(mixed, parts(&[("a", b"2"), ("b", b"1")], &[("c", b""), ("d", b"3")]));
        let end = mixed.len() - b"\0behind".len();
        assert!(sort_attributes(&mut mixed[..end].to_vec()).is_err());
    }

    #[test]
    fn sorted_files_are_read_as_before() {
        let mut to = Cursor::new(Vec::new());
        let values: Vec<f32> = (0..24).map(|v| v as f32).collect();
        write_planes([6, 4], vec![("Z", values.clone())], vec![], &ExposureFacts::default(), &mut to).unwrap();
        let mut bytes = to.into_inner();
        sort_attributes(&mut bytes).unwrap();
        assert_eq!(read_plane(Cursor::new(bytes), "Z").unwrap(), values);
    }

    #[test]
    fn long_headers_are_sorted_in_their_files() {
        let long = vec![b'x'; 3 * FIRST_READ as usize];
        let mut mixed = Cursor::new(file(&[("zebra", &long), ("ant", b"1")]));
        sort_attributes_in(&mut mixed).unwrap();
        assert!(mixed.into_inner() == file(&[("ant", b"1"), ("zebra", &long)]));
        assert!(sort_attributes_in(&mut Cursor::new(b"no EXR at all".to_vec())).is_err());
    }
}

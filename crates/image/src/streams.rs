//! Files as trait objects: codecs are compiled once, in this crate, and not again for each kind of file in each crate that reads or writes one.

use crate::ImageError;
use std::io::{Read, Seek, SeekFrom, Write};

/// What can be read anywhere.
pub(crate) trait ReadSeek: Read + Seek {}

impl<T: Read + Seek + ?Sized> ReadSeek for T {}

/// What can be written anywhere.
pub(crate) trait WriteSeek: Write + Seek {}

impl<T: Write + Seek + ?Sized> WriteSeek for T {}

/// The first bytes of a file, at most `most`; the file stays where it is.
pub(crate) fn beginning(from: &mut (impl Read + Seek + ?Sized), most: u64) -> Result<Vec<u8>, ImageError> {
    let start = from.stream_position()?;
    let mut bytes = Vec::new();
    Read::take(&mut *from, most).read_to_end(&mut bytes)?;
    from.seek(SeekFrom::Start(start))?;
    Ok(bytes)
}

/// The error of a file that does not begin as its format does: what it is, and what belongs there.
pub(crate) fn foreign(format: &'static str, bytes: &[u8], expected: &str) -> ImageError {
    let found = match bytes {
        [] => "the file is empty",
        [0x76, 0x2f, 0x31, 0x01, ..] => "it is an EXR file, as focal planes and pictures of light are",
        [b'I', b'I', b'*', 0, ..] | [b'M', b'M', 0, b'*', ..] => "it is a TIFF file, as raw files (DNG) are",
        [0x89, b'P', b'N', b'G', ..] => "it is a PNG picture",
        [0xff, 0xd8, 0xff, ..] => "it is a JPEG picture",
        _ if bytes.iter().all(|b| matches!(b, b' '..=b'~' | b'\t' | b'\r' | b'\n')) => "it is a text",
        _ => "it is something else",
    };
    ImageError::Malformed { format, reason: format!("{found}; expected {expected}") }
}

#[cfg(test)]
mod tests {
    use crate::{dng, exr};
    use std::io::Cursor;

    #[test]
    fn files_of_another_format_are_named_with_the_way() {
        const EXR: &[u8] = &[0x76, 0x2f, 0x31, 0x01, 2, 0, 0, 0];
        for (bytes, found, hint) in [
            (EXR, "it is an EXR file", "diopter read-out"),
            (b"", "the file is empty", "a raw file (DNG)"),
            (b"hello\n", "it is a text", "a raw file (DNG)"),
            (b"\x89PNG\r\n", "it is a PNG picture", "a raw file (DNG)"),
            (b"\0\x01", "it is something else", "a raw file (DNG)"),
        ] {
            let error = dng::read(Cursor::new(bytes)).unwrap_err().to_string();
            assert!(error.contains(found) && error.contains(hint), "{error}");
        }
        for (bytes, found) in
            [(&b"II*\0\x08\0\0\0"[..], "it is a TIFF file"), (b"", "the file is empty"), (b"a: 1", "it is a text")]
        {
            for error in [exr::read_focal_plane(Cursor::new(bytes)).unwrap_err(), exr::read_rgb(Cursor::new(bytes)).unwrap_err()]
            {
                let error = error.to_string();
                assert!(
                    error.contains(found) && error.contains("expected an EXR file (diopter develop takes raw files)"),
                    "{error}"
                );
            }
        }
    }
}

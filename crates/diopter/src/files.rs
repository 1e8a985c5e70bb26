//! Files and streams as they are given by name: regular files at any size, everything else (pipes, devices, `-` for standard input) up to a
//! bound.
//!
//! A stream can be read once only and cannot be sought in. It is therefore read whole into memory, and kept until the program ends: whoever
//! opens the same name again sees the same bytes.

use std::fs::File;
use std::io::{self, BufRead, BufReader, Cursor, IsTerminal, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

/// The name of standard input.
pub const STANDARD_INPUT: &str = "-";

/// Most bytes that are read of what is no regular file: `/dev/zero` and its like never end.
pub const MOST_STREAM_BYTES: u64 = 1 << 30;

/// Streams that have been read.
static STREAMS: Mutex<Vec<(PathBuf, Arc<[u8]>)>> = Mutex::new(Vec::new());

/// An open file, or a stream in memory.
pub enum Source {
    /// A regular file.
    File(BufReader<File>),
    /// What a stream held.
    Stream(Cursor<Arc<[u8]>>),
}

impl Read for Source {
    fn read(&mut self, to: &mut [u8]) -> io::Result<usize> {
        match self {
            Source::File(file) => file.read(to),
            Source::Stream(bytes) => bytes.read(to),
        }
    }
}

impl BufRead for Source {
    fn fill_buf(&mut self) -> io::Result<&[u8]> {
        match self {
            Source::File(file) => file.fill_buf(),
            Source::Stream(bytes) => bytes.fill_buf(),
        }
    }

    fn consume(&mut self, amount: usize) {
        match self {
            Source::File(file) => file.consume(amount),
            Source::Stream(bytes) => bytes.consume(amount),
        }
    }
}

impl Seek for Source {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        match self {
            Source::File(file) => file.seek(to),
            Source::Stream(bytes) => bytes.seek(to),
        }
    }
}

/// Opens a file, or a stream (`-`: standard input) of at most [`MOST_STREAM_BYTES`]. Fails on what is not there, cannot be read or is a folder, where standard input is
/// the terminal, and on longer streams.
pub fn open(path: &Path) -> io::Result<Source> {
    let standard_input = path == Path::new(STANDARD_INPUT);
    if !standard_input {
        let told = std::fs::metadata(path).map_err(|e| in_words(path, e))?;
        if told.is_dir() {
            return Err(io::Error::new(io::ErrorKind::IsADirectory, "this is a folder; expected a file"));
        }
        if told.is_file() {
            return Ok(Source::File(BufReader::new(File::open(path).map_err(|e| in_words(path, e))?)));
        }
    }
    let mut streams = STREAMS.lock().unwrap_or_else(PoisonError::into_inner);
    if let Some((_, bytes)) = streams.iter().find(|s| s.0 == path) {
        return Ok(Source::Stream(Cursor::new(bytes.clone())));
    }
    if standard_input && io::stdin().is_terminal() {
        let what = "standard input is the terminal; expected a pipe or a file, such as: diopter ... - < FILE";
        return Err(io::Error::new(io::ErrorKind::InvalidInput, what));
    }
    let bytes = match standard_input {
        true => bounded(io::stdin().lock(), MOST_STREAM_BYTES)?,
        false => bounded(File::open(path).map_err(|e| in_words(path, e))?, MOST_STREAM_BYTES)?,
    };
    let bytes: Arc<[u8]> = bytes.into();
    streams.push((path.to_owned(), bytes.clone()));
    Ok(Source::Stream(Cursor::new(bytes)))
}

/// What keeps a file from being opened, in words that follow its name: "there is no such file", "there is no folder a/b". The kind of the error stays.
pub fn in_words(path: &Path, e: io::Error) -> io::Error {
    // The outermost folder that is missing, or that is a file.
    let folders: Vec<&Path> = path.ancestors().skip(1).filter(|f| !f.as_os_str().is_empty()).collect();
    let no_folder = folders.iter().rev().find(|f| !f.is_dir());
    let words = match (e.kind(), no_folder) {
        (io::ErrorKind::NotFound | io::ErrorKind::NotADirectory, Some(folder)) if folder.exists() => {
            format!("{} is a file; expected a folder", folder.display())
        }
        (io::ErrorKind::NotFound, Some(folder)) => format!("there is no folder {}", folder.display()),
        (io::ErrorKind::NotFound, None) => "there is no such file".to_owned(),
        (io::ErrorKind::PermissionDenied, _) => "its permissions, or those of a folder that it is in, do not allow it".to_owned(),
        _ => without_number(&e.to_string()),
    };
    io::Error::new(e.kind(), words)
}

/// A message without the numbers that the system gives its errors, " (os error 28)": the words before say the same.
pub fn without_number(message: &str) -> String {
    const NUMBER: &str = " (os error ";
    let mut parts = message.split(NUMBER);
    let mut text = parts.next().unwrap_or_default().to_owned();
    for part in parts {
        match part.split_once(')') {
            Some((number, rest)) if number.parse::<i32>().is_ok() => text += rest,
            _ => text.extend([NUMBER, part]),
        }
    }
    text
}

/// All bytes of a file or stream. Fails as [`open`], and where reading fails.
pub fn read(path: &Path) -> io::Result<Vec<u8>> {
    match open(path)? {
        Source::File(file) => {
            // Knows the length, and asks for the memory at once.
            let mut bytes = Vec::new();
            file.into_inner().read_to_end(&mut bytes)?;
            Ok(bytes)
        }
        Source::Stream(bytes) => Ok(bytes.into_inner().to_vec()),
    }
}

/// All text of a file or stream. Fails as [`read`], and on what is not UTF-8.
pub fn read_text(path: &Path) -> io::Result<String> {
    String::from_utf8(read(path)?).map_err(|_| io::Error::new(io::ErrorKind::InvalidData, "it is not text (UTF-8)"))
}

/// All bytes of a stream; an error where there are more than `most`.
fn bounded(stream: impl Read, most: u64) -> io::Result<Vec<u8>> {
    let mut bytes = Vec::new();
    stream.take(most + 1).read_to_end(&mut bytes)?;
    match bytes.len() as u64 > most {
        true => Err(io::Error::new(
            io::ErrorKind::FileTooLarge,
            format!("this is no file but a stream, and holds more than {most} bytes; save it as a file first"),
        )),
        false => Ok(bytes),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn streams_without_an_end_are_refused() {
        assert_eq!(bounded(&b"12345"[..], 5).unwrap(), b"12345");
        let error = bounded(io::repeat(0), 1000).unwrap_err();
        assert!(error.to_string().contains("more than 1000 bytes"), "{error}");
    }

    #[test]
    fn messages_lose_the_numbers_of_the_system() {
        let full = "a.jpg: cannot be written: No space left on device (os error 28)";
        assert_eq!(without_number(full), "a.jpg: cannot be written: No space left on device");
        assert_eq!(without_number("a (os error 1): b (os error x)"), "a: b (os error x)");
    }

    #[test]
    fn files_are_read_and_folders_named() {
        let folder = std::env::temp_dir().join(format!("diopter-files-{}", std::process::id()));
        std::fs::create_dir_all(&folder).unwrap();
        let path = folder.join("a.txt");
        std::fs::write(&path, "text").unwrap();
        assert_eq!(read_text(&path).unwrap(), "text");
        let mut source = open(&path).unwrap();
        source.seek(SeekFrom::Start(2)).unwrap();
        let mut rest = String::new();
        source.read_to_string(&mut rest).unwrap();
        assert_eq!(rest, "xt");
        std::fs::write(&path, [0xff, 0xfe, 0]).unwrap();
        assert!(read_text(&path).unwrap_err().to_string().contains("not text"));
        assert!(open(&folder).err().unwrap().to_string().contains("folder"));
        for (name, words, kind) in [
            ("b", "there is no such file".to_owned(), io::ErrorKind::NotFound),
            ("c/d/b", format!("there is no folder {}", folder.join("c").display()), io::ErrorKind::NotFound),
            ("a.txt/b", format!("{} is a file; expected a folder", path.display()), io::ErrorKind::NotADirectory),
        ] {
            let error = open(&folder.join(name)).err().unwrap();
            assert_eq!((error.to_string(), error.kind()), (words, kind));
        }
        let denied = in_words(&path, io::Error::from(io::ErrorKind::PermissionDenied));
        assert!(denied.kind() == io::ErrorKind::PermissionDenied && denied.to_string().contains("permissions"), "{denied}");
        std::fs::remove_dir_all(&folder).unwrap();
    }
}

//! Tar archives with nothing in them but names and bytes: the same files make the same archive, whoever writes it and when.
//!
//! Format: ustar of POSIX.1-1988 (IEEE Std 1003.1-2017, `pax`, "ustar Interchange Format"), regular files with names of at most 100 bytes, mode 0644,
//! owner, group and time of change 0.

use std::io::{self, Read};

/// Headers and data are multiples of so many bytes.
const BLOCK: usize = 512;
/// Two empty blocks end an archive.
const END: usize = 2 * BLOCK;
/// Largest file, bytes: eleven octal digits.
const MOST_BYTES: u64 = (1 << 33) - 1;
/// Longest name, bytes.
const MOST_NAME: usize = 100;

fn header(name: &str, size: u64) -> io::Result<[u8; BLOCK]> {
    let bad = |text: String| Err(io::Error::new(io::ErrorKind::InvalidInput, text));
    if name.is_empty() || name.len() > MOST_NAME {
        return bad(format!("name \"{name}\": expected 1 to {MOST_NAME} bytes"));
    }
    if size > MOST_BYTES {
        return bad(format!("{name} has {size} bytes: expected at most {MOST_BYTES}"));
    }
    let mut block = [0u8; BLOCK];
    let mut set = |at: usize, text: &[u8]| block[at..at + text.len()].copy_from_slice(text);
    set(0, name.as_bytes());
    set(100, b"0000644\0");
    set(108, b"0000000\0");
    set(116, b"0000000\0");
    set(124, format!("{size:011o}\0").as_bytes());
    set(136, b"00000000000\0");
    // The sum of all bytes, with blanks in its own place.
    set(148, b"        ");
    set(156, b"0");
    set(257, b"ustar\x0000");
    let sum = check_sum(&block);
    block[148..156].copy_from_slice(format!("{sum:06o}\0 ").as_bytes());
    Ok(block)
}

fn check_sum(block: &[u8; BLOCK]) -> u32 {
    block.iter().enumerate().map(|(i, b)| if (148..156).contains(&i) { u32::from(b' ') } else { u32::from(*b) }).sum()
}

/// An archive of files, in this order. Fails on a name that is empty or longer than 100 bytes, and on a file of 8 GiB or more.
pub fn archive<'a>(files: impl IntoIterator<Item = (&'a str, &'a [u8])>) -> io::Result<Vec<u8>> {
    let mut out = Vec::new();
    for (name, bytes) in files {
        out.extend_from_slice(&header(name, bytes.len() as u64)?);
        out.extend_from_slice(bytes);
        out.resize(out.len().next_multiple_of(BLOCK), 0);
    }
    out.resize(out.len() + END, 0);
    Ok(out)
}

/// What stands before the end of an archive that [`archive`] made: archives are joined by putting these one after another, and an [`end`] behind.
pub fn entries(archive: &[u8]) -> &[u8] {
    &archive[..archive.len().saturating_sub(END)]
}

/// The end of an archive.
pub fn end() -> [u8; END] {
    [0; END]
}

/// Reads an archive that [`archive`] made, file by file, in memory one at a time. Fails where it is no such archive or is cut off.
pub fn read(mut from: impl Read, mut each: impl FnMut(&str, &[u8]) -> io::Result<()>) -> io::Result<()> {
    let bad = |text: &str| io::Error::new(io::ErrorKind::InvalidData, format!("no tar archive of ours: {text}"));
    let mut bytes = Vec::new();
    loop {
        let mut block = [0u8; BLOCK];
        from.read_exact(&mut block)?;
        if block.iter().all(|b| *b == 0) {
            return Ok(());
        }
        let octal = |field: &[u8]| {
            let text = std::str::from_utf8(field).ok()?.trim_matches(['\0', ' ']);
            u64::from_str_radix(text, 8).ok()
        };
        if octal(&block[148..156]) != Some(u64::from(check_sum(&block))) {
            return Err(bad("the check sum of a header is wrong"));
        }
        let name = block[..MOST_NAME].split(|b| *b == 0).next().unwrap_or_default();
        let name = std::str::from_utf8(name).map_err(|_| bad("a name is not text"))?;
        let size = octal(&block[124..136]).filter(|s| *s <= MOST_BYTES).ok_or_else(|| bad("a size is no number"))?;
        bytes.clear();
        // Asks for memory as bytes come, not as a header says.
        from.by_ref().take(size.next_multiple_of(BLOCK as u64)).read_to_end(&mut bytes)?;
        if (bytes.len() as u64) < size.next_multiple_of(BLOCK as u64) {
            return Err(io::Error::new(io::ErrorKind::UnexpectedEof, "the archive is cut off"));
        }
        each(name, &bytes[..size as usize])?;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_come_back_and_archives_join() {
        let long = vec![7u8; 1500];
        let files: [(&str, &[u8]); 3] = [("a.json", b"{}"), ("a.npy", &long), ("b.txt", b"")];
        let whole = archive(files).unwrap();
        assert_eq!(whole.len() % BLOCK, 0);
        let mut found = Vec::new();
        read(&whole[..], |name, bytes| {
            found.push((name.to_owned(), bytes.to_vec()));
            Ok(())
        })
        .unwrap();
        assert_eq!(found, files.map(|(n, b)| (n.to_owned(), b.to_vec())));
        let parts = [archive(files[..1].iter().copied()).unwrap(), archive(files[1..].iter().copied()).unwrap()];
        let joined: Vec<u8> = parts.iter().flat_map(|p| entries(p).to_vec()).chain(end()).collect();
        assert_eq!(joined, whole);
        // Cut off, or changed.
        assert!(read(&whole[..whole.len() - 2 * BLOCK - 100], |_, _| Ok(())).is_err());
        let mut changed = whole.clone();
        changed[3] ^= 1;
        assert!(read(&changed[..], |_, _| Ok(())).unwrap_err().to_string().contains("check sum"));
    }

    #[test]
    fn headers_are_those_of_the_standard() {
        // As Python's tarfile writes it: TarInfo("a.txt") with size 3, mode 0o644, mtime 0, uid 0, gid 0, no names of owners; format USTAR.
        let block = header("a.txt", 3).unwrap();
        assert_eq!(&block[148..156], b"006717\0 ");
        assert_eq!(&block[257..265], b"ustar\x0000");
        assert!(header(&"x".repeat(101), 0).is_err() && header("x", 1 << 33).is_err());
    }
}

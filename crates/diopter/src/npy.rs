//! Arrays as numpy's files. Format: NEP 1, version 1.0: little-endian, row by row.

/// Numbers that an array can hold.
pub trait Number: Copy {
    /// numpy's name of the type.
    const DTYPE: &'static str;
    /// Appends its bytes.
    fn append_to(self, to: &mut Vec<u8>);
}

macro_rules! number {
    ($kind:ty, $dtype:literal) => {
        impl Number for $kind {
            const DTYPE: &'static str = $dtype;
            fn append_to(self, to: &mut Vec<u8>) {
                to.extend_from_slice(&self.to_le_bytes());
            }
        }
    };
}

number!(u8, "|u1");
number!(u16, "<u2");
number!(u32, "<u4");
number!(f32, "<f4");
number!(f64, "<f8");

/// What stands before the numbers of an array, row by row: `descr` as Python writes it, `shape` likewise ("(2, 3)").
pub fn header(descr: &str, shape: &str) -> Vec<u8> {
    let mut header = format!("{{'descr': {descr}, 'fortran_order': False, 'shape': {shape}, }}");
    // Magic, version and length take ten bytes; data begins at a multiple of 64.
    while !(10 + header.len() + 1).is_multiple_of(64) {
        header.push(' ');
    }
    header.push('\n');
    let mut out = b"\x93NUMPY\x01\x00".to_vec();
    out.extend_from_slice(&(header.len() as u16).to_le_bytes());
    out.extend_from_slice(header.as_bytes());
    out
}

/// An array of `[row][column][channel]`, as many numbers as `[width, height, channels]` says; of one channel `[row][column]`.
pub fn array<T: Number>(data: &[T], [width, height, channels]: [usize; 3]) -> Vec<u8> {
    if channels == 1 { with_shape(data, &[height, width]) } else { with_shape(data, &[height, width, channels]) }
}

/// An array of a shape of two or more sides, the last one running fastest.
pub fn with_shape<T: Number>(data: &[T], shape: &[usize]) -> Vec<u8> {
    let shape = format!("({})", shape.iter().map(usize::to_string).collect::<Vec<_>>().join(", "));
    let mut out = header(&format!("'{}'", T::DTYPE), &shape);
    out.reserve(size_of_val(data));
    data.iter().for_each(|v| v.append_to(&mut out));
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn arrays_are_those_of_numpy() {
        // numpy.save of numpy.arange(6, dtype="<u2").reshape(2, 3).
        let bytes = array(&[0u16, 1, 2, 3, 4, 5], [3, 2, 1]);
        assert_eq!(&bytes[..10], b"\x93NUMPY\x01\x00\x76\x00");
        assert!(bytes[10..128].starts_with(b"{'descr': '<u2', 'fortran_order': False, 'shape': (2, 3), }  "));
        assert_eq!((bytes[127], bytes.len()), (b'\n', 140));
        assert_eq!(&bytes[128..], [0, 0, 1, 0, 2, 0, 3, 0, 4, 0, 5, 0]);
        assert!(
            String::from_utf8_lossy(&array(&[1.0f32; 8], [2, 2, 2]))
                .contains("'<f4', 'fortran_order': False, 'shape': (2, 2, 2)")
        );
    }
}

//! Pictures for textures and of light.

use crate::texture::Image;
use diopter_image::Raster;
use image::{DynamicImage, ExtendedColorType, ImageDecoder, ImageFormat};
use std::io::Cursor;

/// Most pixels a side of a picture.
const LARGEST_IMAGE: u32 = 32_768;

/// What a picture is that is read elsewhere or not at all, where its first bytes tell. Source: Khronos KTX File Format Specifications 1.0 and 2.0.
fn other_format(bytes: &[u8]) -> Option<&'static str> {
    match bytes {
        [0xab, b'K', b'T', b'X', b' ', b'2', b'0', 0xbb, ..] => Some("a KTX 2 picture, which is read in glTF files alone"),
        [0xab, b'K', b'T', b'X', b' ', b'1', b'1', 0xbb, ..] => Some("a KTX 1 picture"),
        _ => None,
    }
}

/// Pixels that any file may announce, however short it is: 4 MiB as 8-bit codes.
const ALWAYS: u64 = 1 << 20;

/// The same of formats in which a picture of one colour takes some bytes at any size (lossless WebP, Basis Universal, fax): 64 MiB.
const ALWAYS_PACKED: u64 = 1 << 24;

/// Most pixels for each byte of a file in those formats, beyond what is always read: an explicit limit, since the formats have none.
const PACKED: u64 = 16_384;

/// Pixels of a picture that are at most kept for each byte of its file, and those that are always.
///
/// PNG: deflate makes 258 bytes of 2 bits (RFC 1951), of 8 pixels each. JPEG: each block of 8 × 8 numbers takes a bit at least, and two components
/// at a quarter of the resolution in one direction each share 1024 pixels between 9 blocks. Targa: 128 pixels from 2 bytes. BMP: a row of
/// 32768 pixels that ends at once from 2 bytes. TIFF: LZW makes 4096 bytes of 12 bits at best, of 8 pixels each; of black and white a row of fax is
/// a bit, which is limited as the packed formats are. QOI: 62 pixels from a byte.
fn most_pixels(format: ImageFormat, colors: ExtendedColorType) -> (u64, u64) {
    match format {
        ImageFormat::Jpeg => (1024, ALWAYS),
        ImageFormat::WebP => (PACKED, ALWAYS_PACKED),
        ImageFormat::Tga => (64, ALWAYS),
        ImageFormat::Bmp => (16_384, ALWAYS),
        ImageFormat::Qoi => (62, ALWAYS),
        ImageFormat::Tiff if colors == ExtendedColorType::L1 => (PACKED, ALWAYS_PACKED),
        ImageFormat::Tiff => (8 * 2731, ALWAYS),
        _ => (8 * 1032, ALWAYS),
    }
}

/// Holds the size that a header announces against the length of its file, before memory is asked for.
fn check_size([width, height]: [u32; 2], length: usize, (for_each, always): (u64, u64)) -> Result<(), String> {
    if !(1..=LARGEST_IMAGE).contains(&width) || !(1..=LARGEST_IMAGE).contains(&height) {
        return Err(format!("it has {width} × {height} pixels: expected 1 to {LARGEST_IMAGE} a side"));
    }
    let most = (length as u64).saturating_mul(for_each).max(always);
    if u64::from(width) * u64::from(height) > most {
        return Err(format!(
            "{width} × {height} pixels are announced, and {length} bytes of this format can become {most} at most: it is cut short or \
             damaged"
        ));
    }
    Ok(())
}

/// Holds the size of a picture in a format of Basis Universal against the length of its file.
pub(super) fn check_packed(size: [u32; 2], length: usize) -> Result<(), String> {
    check_size(size, length, (PACKED, ALWAYS_PACKED))
}

/// Reads the codes of a picture (PNG, JPEG, WebP, Targa, BMP, TIFF, QOI) as RGB, 0 to 1 whatever their depth; grey ones three times. Fails with the reason.
pub fn read_codes(bytes: &[u8]) -> Result<Raster<f32>, String> {
    let picture = decoded(bytes)?.into_rgb32f();
    let (width, height) = (picture.width() as usize, picture.height() as usize);
    Ok(Raster { width, height, channels: 3, data: picture.into_raw() })
}

/// The colour profile (ICC) that a picture carries; `None` without one, and of what cannot be read.
pub fn read_profile(bytes: &[u8]) -> Option<Vec<u8>> {
    let format = image::guess_format(bytes).ok()?;
    if format == ImageFormat::Tiff {
        // The other reader may hold no more than the picture's own bytes, which refuses the profile of a small one.
        return diopter_image::tiff_file::profile(bytes);
    }
    image::ImageReader::with_format(Cursor::new(bytes), format).into_decoder().ok()?.icc_profile().ok()?
}

/// Reads a picture as its file has it: codes of 8 or 16 bits a channel, or numbers.
fn read_picture(bytes: &[u8]) -> Result<Image, String> {
    let picture = decoded(bytes)?;
    let (width, height) = (picture.width() as usize, picture.height() as usize);
    // The library's own conversion takes several times as long for these.
    let pixels = match picture {
        DynamicImage::ImageRgb8(rgb) => rgb.into_raw().as_chunks().0.iter().map(|[r, g, b]| [*r, *g, *b, 255]).collect(),
        DynamicImage::ImageLuma8(grey) => grey.into_raw().into_iter().map(|v| [v, v, v, 255]).collect(),
        deep @ (DynamicImage::ImageLuma16(_)
        | DynamicImage::ImageLumaA16(_)
        | DynamicImage::ImageRgb16(_)
        | DynamicImage::ImageRgba16(_)) => {
            let pixels = deep.into_rgba16().into_raw().as_chunks().0.to_vec();
            return Ok(Image::of_codes16(width, height, pixels));
        }
        numbers @ (DynamicImage::ImageRgb32F(_) | DynamicImage::ImageRgba32F(_)) => {
            return Ok(Image::linear(width, height, numbers.into_rgba32f().into_raw().as_chunks().0.to_vec()));
        }
        other => other.into_rgba8().into_raw().as_chunks().0.to_vec(),
    };
    Ok(Image::new(width, height, pixels))
}

/// A picture as its file has it. Targa files have no mark of their own: what is nothing else is tried as one.
fn decoded(bytes: &[u8]) -> Result<DynamicImage, String> {
    if let Some(what) = other_format(bytes) {
        return Err(format!("it is {what}, none of PNG, JPEG, WebP, Targa, BMP, TIFF, QOI, EXR, HDR, PFM"));
    }
    let format = image::guess_format(bytes).unwrap_or(ImageFormat::Tga);
    if format == ImageFormat::Jpeg && is_cut_jpeg(bytes) {
        return Err("the picture is cut short: it has no end".to_owned());
    }
    let unknown = "it is none of PNG, JPEG, WebP, Targa, BMP, TIFF, QOI, EXR, HDR, PFM";
    let wrong = |e: image::ImageError| if format == ImageFormat::Tga { unknown.to_owned() } else { e.to_string() };
    let mut reader = image::ImageReader::with_format(Cursor::new(bytes), format);
    let mut limits = image::Limits::no_limits();
    // The largest picture of 16-bit numbers.
    limits.max_alloc = Some(u64::from(LARGEST_IMAGE) * u64::from(LARGEST_IMAGE) * 8);
    reader.limits(limits);
    let decoder = reader.into_decoder().map_err(wrong)?;
    let (width, height) = decoder.dimensions();
    let size = check_size([width, height], bytes.len(), most_pixels(format, decoder.original_color_type()));
    size.map_err(|e| if format == ImageFormat::Tga { format!("{unknown} (as Targa: {e})") } else { e })?;
    DynamicImage::from_decoder(decoder).map_err(wrong)
}

/// Whether the end of a JPEG file is missing, whose decoder fills the rest with grey. Source: ITU-T T.81, annex B: an end of image (FF D9) stands behind the scans, in which FF is followed by 00 or the
/// number of a restart.
fn is_cut_jpeg(bytes: &[u8]) -> bool {
    let mut at = 2;
    // Segments before the first scan, which may hold pictures of their own.
    while let Some([0xff, marker, high, low]) = bytes.get(at..at + 4) {
        match marker {
            // Fill bytes.
            0xff => at += 1,
            0xda => return !bytes[at..].windows(2).any(|pair| pair == [0xff, 0xd9]),
            _ => at += 2 + usize::from(u16::from_be_bytes([*high, *low])),
        }
    }
    // What is wrong there its decoder tells.
    false
}

/// Reads a picture for a texture: EXR, Radiance, PFM and TIFF of floating-point numbers as linear numbers, others as codes.
pub(super) fn read_texture(bytes: &[u8]) -> Result<Image, String> {
    if !is_light(bytes) {
        return read_picture(bytes).map(Image::kept);
    }
    let picture = read_light_picture(bytes)?;
    let texels = picture.data.as_chunks::<3>().0.iter().map(|[r, g, b]| [*r, *g, *b, 1.0]).collect();
    Ok(Image::linear(picture.width, picture.height, texels).kept())
}

/// Whether a picture is one of EXR's, Radiance's or PFM's.
fn is_light(bytes: &[u8]) -> bool {
    bytes.starts_with(&[0x76, 0x2f, 0x31, 0x01]) || bytes.starts_with(b"#?") || is_pfm(bytes)
}

fn is_pfm(bytes: &[u8]) -> bool {
    matches!(bytes, [b'P', b'F' | b'f', white, ..] if white.is_ascii_whitespace())
}

/// Reads a picture of light as linear RGB: EXR, Radiance or PFM, upper row first. Fails with the reason where it is none of these, damaged or cut short.
pub fn read_light(bytes: &[u8]) -> Result<Raster<f32>, String> {
    if is_light(bytes) { read_light_picture(bytes) } else { Err("it is none of EXR, Radiance HDR, PFM".into()) }
}

/// Reads a portable float map (P. Debevec): "PF" or "Pf", width, height, a scale whose sign tells the order of bytes (negative: little-endian), rows from
/// the bottom. Numbers are multiplied by the scale's magnitude, as pbrt does.
fn read_pfm(bytes: &[u8]) -> Result<Raster<f32>, String> {
    let mut at = 0;
    let mut word = || {
        let start = at + bytes[at..].iter().take_while(|b| b.is_ascii_whitespace()).count();
        let end = start + bytes[start..].iter().take_while(|b| !b.is_ascii_whitespace()).count();
        at = end;
        std::str::from_utf8(&bytes[start..end]).unwrap_or_default()
    };
    let channels = if word() == "PF" { 3 } else { 1 };
    let side = |text: &str| text.parse::<usize>().ok().filter(|n| (1..=LARGEST_IMAGE as usize).contains(n));
    let wrong = |what: &str, text: &str| {
        let expected = match what {
            "scale" => "a number other than 0".to_owned(),
            _ => format!("1 to {LARGEST_IMAGE} pixels"),
        };
        format!("a PFM picture whose {what} is \"{text}\"; expected {expected}")
    };
    let text = word();
    let width = side(text).ok_or_else(|| wrong("width", text))?;
    let text = word();
    let height = side(text).ok_or_else(|| wrong("height", text))?;
    let text = word();
    let scale = text.parse::<f32>().ok().filter(|s| *s != 0.0 && s.is_finite()).ok_or_else(|| wrong("scale", text))?;
    // One white space ends the header.
    let data = bytes.get(at + 1..).unwrap_or_default().as_chunks::<4>().0;
    if data.len() < width * height * channels {
        return Err(format!("a PFM picture that ends early: {} numbers; expected {}", data.len(), width * height * channels));
    }
    let number = |i: usize| scale.abs() * if scale < 0.0 { f32::from_le_bytes(data[i]) } else { f32::from_be_bytes(data[i]) };
    let mut picture = Raster::new(width, height, 3);
    for row in 0..height {
        for column in 0..width {
            let start = ((height - 1 - row) * width + column) * channels;
            let pixel = std::array::from_fn::<f32, 3, _>(|c| number(start + c.min(channels - 1)));
            picture.pixel_mut(column, row).copy_from_slice(&pixel);
        }
    }
    Ok(picture)
}

/// Reads a picture of light as linear RGB: EXR, Radiance, PFM and TIFF of floating-point numbers as they are, others by the sRGB function.
pub(super) fn read_light_picture(bytes: &[u8]) -> Result<Raster<f32>, String> {
    if bytes.starts_with(&[0x76, 0x2f, 0x31, 0x01]) {
        return diopter_image::exr::read_rgb(Cursor::new(bytes)).map_err(|e| e.to_string());
    }
    if bytes.starts_with(b"#?") {
        return read_hdr(bytes);
    }
    if is_pfm(bytes) {
        return read_pfm(bytes);
    }
    let picture = decoded(bytes)?;
    let is_linear = matches!(picture, DynamicImage::ImageRgb32F(_) | DynamicImage::ImageRgba32F(_));
    let picture = picture.into_rgb32f();
    let (width, height, mut data) = (picture.width() as usize, picture.height() as usize, picture.into_raw());
    if !is_linear {
        data.iter_mut().for_each(|v| *v = diopter_light::color::srgb_decode(*v));
    }
    Ok(Raster { width, height, channels: 3, data })
}

/// Reads a Radiance `.hdr` picture as linear RGB.
fn read_hdr(bytes: &[u8]) -> Result<Raster<f32>, String> {
    let decoder = image::codecs::hdr::HdrDecoder::new(Cursor::new(bytes)).map_err(|e| e.to_string())?;
    let (width, height) = decoder.dimensions();
    // A row takes a pixel of 4 bytes, and for more than one pixel a run of 4 bytes, which repeats it at most 255 times; a second run that follows
    // repeats it 256 times as often. Source: G. Ward, `color.c` of Radiance.
    let row = match width {
        0..=1 => 4,
        2..=256 => 8,
        _ => 12,
    };
    check_size([width, height], bytes.len(), (u64::from(width.div_ceil(row)), 0))?;
    let picture = DynamicImage::from_decoder(decoder).map_err(|e| e.to_string())?.into_rgb32f();
    let (width, height) = (picture.width() as usize, picture.height() as usize);
    Ok(Raster { width, height, channels: 3, data: picture.into_raw() })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::texture::{Texel, Texels};

    #[test]
    fn float_maps_are_read_from_the_bottom_in_both_orders() {
        // Two columns, two rows: the lower row first.
        let numbers: Vec<f32> = (0..12).map(|i| i as f32 * 0.5).collect();
        let little: Vec<u8> = numbers.iter().flat_map(|v| v.to_le_bytes()).collect();
        let big: Vec<u8> = numbers.iter().flat_map(|v| v.to_be_bytes()).collect();
        for (scale, factor, data) in [("-1.0", 1.0, &little), ("2", 2.0, &big)] {
            let bytes = [format!("PF\n2 2\n{scale}\n").as_bytes(), data].concat();
            let picture = read_light_picture(&bytes).unwrap();
            assert_eq!((picture.width, picture.height), (2, 2));
            assert_eq!(picture.pixel(0, 1), [0.0, 0.5, 1.0].map(|v| v * factor));
            assert_eq!(picture.pixel(1, 0), [4.5, 5.0, 5.5].map(|v| v * factor));
            assert!(matches!(read_texture(&bytes).unwrap().texels, Texels::Linear(_)));
            for cut in 0..bytes.len() {
                assert!(read_light_picture(&bytes[..cut]).is_err(), "{cut}");
            }
        }
        let grey = [b"Pf 1 1 -1\n".as_slice(), &7f32.to_le_bytes()].concat();
        assert_eq!(read_light_picture(&grey).unwrap().data, [7.0; 3]);
        for wrong in ["PF 0 1 -1\n", "PF 1 99999999 -1\n", "PF 2 2 0\n", "PF 2 x 1\n", "PF"] {
            assert!(read_pfm(wrong.as_bytes()).is_err(), "{wrong}");
        }
    }

    #[test]
    fn sizes_that_the_bytes_cannot_become_are_refused() {
        let hdr = |size: &str| format!("#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n{size}\n\u{1}\u{1}\u{1}\u{1}").into_bytes();
        for size in ["-Y 1 +X 2000000000", "-Y 2000000000 +X 1", "-Y 30000 +X 30000", "-Y 65535 +X 65535", "-Y 200 +X 3"] {
            let e = read_light_picture(&hdr(size)).unwrap_err();
            assert!(e.contains("pixels"), "{size}: {e}");
        }
        assert!(
            read_light_picture(&[b"PF\n32768 32768\n-1\n".as_slice(), &[0; 64]].concat()).unwrap_err().contains("ends early")
        );

        let word = |v: u32| v.to_le_bytes();
        // BMP: header of the file, header of the picture (40 bytes, 24 bits a pixel).
        let mut bmp = b"BM".to_vec();
        [400, 0, 54, 40, 30_000, 30_000, 1 | 24 << 16, 0, 0, 0, 0, 0, 0].iter().for_each(|v| bmp.extend(word(*v)));
        // Targa: of true colour, in runs, 24 bits.
        let mut tga = vec![0, 0, 10, 0, 0, 0, 0, 0, 0, 0, 0, 0];
        tga.extend([30_000u16.to_le_bytes(), 30_000u16.to_le_bytes()].concat());
        tga.extend([24, 0]);
        let qoi = [b"qoif".as_slice(), &30_000u32.to_be_bytes(), &30_000u32.to_be_bytes(), &[4, 0]].concat();
        // TIFF as the encoder writes a small picture, with another size.
        let mut tiff = Vec::new();
        image::RgbImage::new(4, 4).write_to(&mut Cursor::new(&mut tiff), ImageFormat::Tiff).unwrap();
        let directory = u32::from_le_bytes([tiff[4], tiff[5], tiff[6], tiff[7]]) as usize;
        let fields = u16::from_le_bytes([tiff[directory], tiff[directory + 1]]) as usize;
        for field in 0..fields {
            let at = directory + 2 + 12 * field;
            // Width and height as numbers of 32 bits.
            if matches!(u16::from_le_bytes([tiff[at], tiff[at + 1]]), 256 | 257) {
                tiff[at + 2..at + 4].copy_from_slice(&[4, 0]);
                tiff[at + 8..at + 12].copy_from_slice(&word(30_000));
            }
        }
        for (name, mut bytes) in [("bmp", bmp), ("tga", tga), ("qoi", qoi), ("tiff", tiff)] {
            bytes.resize(bytes.len().max(400), 0);
            assert!(read_texture(&bytes).is_err(), "{name}");
            assert!(read_light_picture(&bytes).is_err(), "{name}");
        }
        for (size, length, rule, fine) in [
            ([30_000, 30_000], 400, most_pixels(ImageFormat::Png, ExtendedColorType::Rgb8), false),
            ([30_000, 30_000], 110_000, most_pixels(ImageFormat::Png, ExtendedColorType::L1), true),
            ([1000, 1000], 100, most_pixels(ImageFormat::Jpeg, ExtendedColorType::Rgb8), true),
            ([10_000, 10_000], 100, most_pixels(ImageFormat::Jpeg, ExtendedColorType::Rgb8), false),
            ([4096, 4096], 30, most_pixels(ImageFormat::WebP, ExtendedColorType::Rgb8), true),
            ([16_383, 16_383], 30, most_pixels(ImageFormat::WebP, ExtendedColorType::Rgb8), false),
            ([0, 5], 400, most_pixels(ImageFormat::Qoi, ExtendedColorType::Rgb8), false),
            ([40_000, 1], 1 << 30, most_pixels(ImageFormat::Qoi, ExtendedColorType::Rgb8), false),
        ] {
            assert_eq!(check_size(size, length, rule).is_ok(), fine, "{size:?} in {length} bytes");
        }
    }

    #[test]
    fn codes_come_in_many_formats() {
        let picture = image::RgbaImage::from_fn(3, 2, |x, y| image::Rgba([x as u8 * 80, y as u8 * 200, 9, 255]));
        for format in [ImageFormat::Png, ImageFormat::Tga, ImageFormat::Bmp, ImageFormat::Tiff, ImageFormat::Qoi] {
            let mut bytes = Vec::new();
            picture.write_to(&mut Cursor::new(&mut bytes), format).unwrap();
            let read = read_texture(&bytes).unwrap();
            let Texels::Codes(codes) = &read.texels else { panic!("codes") };
            assert_eq!((read.width, read.height, codes[4]), (3, 2, [80, 200, 9, 255]), "{format:?}");
        }
        // Of 16 bits, with a step that 8 bits do not have, and of numbers above 1.
        let deep = image::ImageBuffer::from_fn(2, 1, |x, _| image::Rgb([1000u16 + x as u16, 2000, 65535]));
        for format in [ImageFormat::Png, ImageFormat::Tiff] {
            let mut bytes = Vec::new();
            deep.write_to(&mut Cursor::new(&mut bytes), format).unwrap();
            assert_eq!(read_texture(&bytes).unwrap().texel(1, 0), Texel::Codes16([1001, 2000, 65535, 65535]));
            let light = read_light_picture(&bytes).unwrap();
            assert_eq!((light.data[3], light.data[5]), (diopter_light::color::srgb_decode(1001.0 / 65535.0), 1.0));
        }
        let mut bytes = Vec::new();
        image::Rgb32FImage::from_pixel(1, 1, image::Rgb([2.5, 0.0, 1.0]))
            .write_to(&mut Cursor::new(&mut bytes), ImageFormat::Tiff)
            .unwrap();
        assert_eq!(read_texture(&bytes).unwrap().texel(0, 0), Texel::Linear([2.5, 0.0, 1.0, 1.0]));
        assert_eq!(read_light_picture(&bytes).unwrap().data, [2.5, 0.0, 1.0]);
        assert!(read_texture(b"what is this").unwrap_err().contains("none of"));
        for (version, name) in [("20", "KTX 2"), ("11", "KTX 1")] {
            let bytes = [b"\xabKTX ".as_slice(), version.as_bytes(), b"\xbb\r\n\x1a\n"].concat();
            assert!(read_texture(&bytes).unwrap_err().contains(name));
        }
    }

    #[test]
    fn jpeg_files_that_are_cut_are_told() {
        let picture = image::RgbImage::from_fn(64, 64, |x, y| image::Rgb([(x * y) as u8, x as u8, y as u8]));
        let mut bytes = Vec::new();
        picture.write_to(&mut Cursor::new(&mut bytes), ImageFormat::Jpeg).unwrap();
        assert!(read_texture(&bytes).is_ok());
        // What programs add behind the end is no harm.
        assert!(read_texture(&[&bytes[..], b"0123"].concat()).is_ok());
        for kept in [bytes.len() - 2, bytes.len() / 2 + 200] {
            assert!(read_texture(&bytes[..kept]).is_err_and(|e| e.contains("cut short")), "{kept} of {}", bytes.len());
        }
    }
}

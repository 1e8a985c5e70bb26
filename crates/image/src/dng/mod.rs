//! DNG: the raw file that every converter opens.
//!
//! Source: Adobe, Digital Negative Specification 1.6.0.0 (December 2021); TIFF 6.0. A file holds a small RGB picture (IFD0), the
//! mosaic and a JPEG preview (its SubIFDs), EXIF, and the facts of the exposure as JSON in XMP, which gives back what EXIF rounds.

mod disguise;
pub mod lossless;
pub mod opcode;
mod packing;
mod parts;
mod read;
mod write;

pub use read::read;
pub use write::{Rows, Storage, rows_of, write, write_image};

/// Tags of the specification, by their names there.
mod tag {
    pub const NEW_SUBFILE_TYPE: u16 = 254;
    pub const WIDTH: u16 = 256;
    pub const HEIGHT: u16 = 257;
    pub const BITS_PER_SAMPLE: u16 = 258;
    pub const COMPRESSION: u16 = 259;
    pub const PHOTOMETRIC: u16 = 262;
    pub const STRIP_OFFSETS: u16 = 273;
    pub const SAMPLES_PER_PIXEL: u16 = 277;
    pub const ROWS_PER_STRIP: u16 = 278;
    pub const STRIP_BYTE_COUNTS: u16 = 279;
    pub const X_RESOLUTION: u16 = 282;
    pub const Y_RESOLUTION: u16 = 283;
    pub const PLANAR: u16 = 284;
    pub const RESOLUTION_UNIT: u16 = 296;
    pub const PREDICTOR: u16 = 317;
    pub const TILE_WIDTH: u16 = 322;
    pub const TILE_LENGTH: u16 = 323;
    pub const TILE_OFFSETS: u16 = 324;
    pub const TILE_BYTE_COUNTS: u16 = 325;
    pub const SUB_IFDS: u16 = 330;
    pub const SAMPLE_FORMAT: u16 = 339;
    pub const YCBCR_SUBSAMPLING: u16 = 530;
    pub const YCBCR_POSITIONING: u16 = 531;
    pub const REFERENCE_BLACK_WHITE: u16 = 532;
    pub const XMP: u16 = 700;
    pub const CFA_REPEAT: u16 = 33421;
    pub const CFA_PATTERN: u16 = 33422;
    pub const DNG_VERSION: u16 = 50706;
    pub const DNG_BACKWARD_VERSION: u16 = 50707;
    pub const UNIQUE_CAMERA_MODEL: u16 = 50708;
    pub const CFA_PLANE_COLOR: u16 = 50710;
    pub const CFA_LAYOUT: u16 = 50711;
    pub const LINEARIZATION_TABLE: u16 = 50712;
    pub const BLACK_REPEAT: u16 = 50713;
    pub const BLACK_LEVEL: u16 = 50714;
    pub const WHITE_LEVEL: u16 = 50717;
    pub const DEFAULT_SCALE: u16 = 50718;
    pub const CROP_ORIGIN: u16 = 50719;
    pub const CROP_SIZE: u16 = 50720;
    pub const COLOR_MATRIX: [u16; 2] = [50721, 50722];
    pub const BLACK_DELTA: [u16; 2] = [50715, 50716];
    pub const CAMERA_CALIBRATION: [u16; 2] = [50723, 50724];
    pub const ANALOG_BALANCE: u16 = 50727;
    pub const AS_SHOT_NEUTRAL: u16 = 50728;
    pub const AS_SHOT_WHITE_XY: u16 = 50729;
    pub const ORIENTATION: u16 = 274;
    pub const BASELINE_EXPOSURE: u16 = 50730;
    pub const BASELINE_EXPOSURE_OFFSET: u16 = 51109;
    pub const DEFAULT_USER_CROP: u16 = 51125;
    pub const BASELINE_NOISE: u16 = 50731;
    pub const BASELINE_SHARPNESS: u16 = 50732;
    pub const LINEAR_RESPONSE_LIMIT: u16 = 50734;
    pub const CAMERA_SERIAL: u16 = 50735;
    pub const LENS_INFO: u16 = 50736;
    pub const CALIBRATION_ILLUMINANT: [u16; 2] = [50778, 50779];
    pub const ACTIVE_AREA: u16 = 50829;
    pub const PROFILE_NAME: u16 = 50936;
    pub const FORWARD_MATRIX: [u16; 2] = [50964, 50965];
    pub const PREVIEW_SOFTWARE: u16 = 50966;
    pub const PREVIEW_COLOR_SPACE: u16 = 50970;
    pub const ROW_INTERLEAVE_FACTOR: u16 = 50975;
    pub const COLUMN_INTERLEAVE_FACTOR: u16 = 52547;
    pub const OPCODE_LIST: [u16; 3] = [51008, 51009, 51022];
    pub const NOISE_PROFILE: u16 = 51041;
}

/// Values of the tag Compression.
mod compression {
    pub const NONE: u16 = 1;
    pub const JPEG: u16 = 7;
    pub const DEFLATE: u16 = 8;
    /// Deflate under its older number.
    pub const OLD_DEFLATE: u16 = 32946;
    pub const LOSSY_JPEG: u16 = 34892;
    pub const JPEG_XL: u16 = 52546;
}

/// Values of the tag PhotometricInterpretation.
mod photometric {
    pub const RGB: u16 = 2;
    pub const YCBCR: u16 = 6;
    pub const CFA: u16 = 32803;
    pub const LINEAR_RAW: u16 = 34892;
}

/// Numbers of filters in the tags CFAPattern and CFAPlaneColor.
const FILTER_NUMBERS: [(crate::raw::Filter, u8); 4] = {
    use crate::raw::Filter;
    [(Filter::Red, 0), (Filter::Green, 1), (Filter::Blue, 2), (Filter::Clear, 6)]
};

/// Namespace of our own XMP property.
const XMP_NAMESPACE: &str = "urn:diopter:1.0";

#[cfg(test)]
mod tests {
    use super::*;
    use crate::raw::{Cfa, ColorCalibration, LightSource, RawHeader, RawImage};
    use crate::tags::{Field, write_fields};
    use crate::{ExposureFacts, Raster};
    use std::io::Cursor;

    pub(super) fn image(pattern: &str, bits: u32, width: usize, height: usize) -> RawImage {
        let cfa = if pattern == "linear" { Cfa::linear_rgb() } else { Cfa::parse(pattern).unwrap() };
        let n = cfa.channel_count();
        let mut mosaic = Raster::new(width * cfa.samples_per_pixel(), height, 1);
        let top = ((1u64 << bits) - 1) as u32;
        let value = |i: usize| (i as u32).wrapping_mul(2_654_435_761) % (top + 1);
        mosaic.data.iter_mut().enumerate().for_each(|(i, v)| *v = value(i) as u16);
        let calibration = |light, scale: f64| ColorCalibration {
            light,
            camera_from_xyz: (0..n)
                .map(|c| std::array::from_fn(|k| scale * (1.0 + c as f64 - 0.5 * k as f64 + if c == k { 1.0 } else { 0.0 })))
                .collect(),
            xyz_d50_from_balanced: (0..n)
                .map(|c| std::array::from_fn(|k| scale * (0.25 * (1.0 + (c + k) as f64) + if c == k { 1.0 } else { 0.0 })))
                .collect(),
        };
        let mono = cfa.is_colorless();
        RawImage {
            mosaic,
            header: RawHeader {
                calibrations: if mono {
                    vec![]
                } else {
                    vec![calibration(LightSource::A, 0.5), calibration(LightSource::D65, 0.25)]
                },
                baseline_ev: 1.25,
                framing: Default::default(),
                opcodes: vec![],
                warnings: vec![],
                as_shot_neutral: (0..n).map(|c| 1.0 / (1.0 + c as f64)).collect(),
                noise: (0..n).map(|c| [1e-4 * (1 + c) as f64, 1e-7]).collect(),
                cfa,
                bits,
                black_level: 16.5,
                white_level: top as f64 - 3.0,
                facts: ExposureFacts {
                    make: "Maker".into(),
                    model: "Model “X” – ½".into(),
                    lens: "50 mm f/1.4 <&\"'>".into(),
                    exposure_s: 1.0 / 3.0,
                    focus_distance_m: None,
                    metered_ev100: Some(-2.5),
                    f_number: 2.8284,
                    iso: 102_400.0,
                    ..Default::default()
                },
            },
        }
    }

    #[test]
    fn every_storage_and_pattern_gives_back_each_number() {
        for (pattern, bits) in [
            ("RG/GB", 14),
            ("GB/RG", 12),
            ("x-trans", 16),
            ("quad", 10),
            ("rgbw", 12),
            ("rccc", 12),
            ("mono", 16),
            ("linear", 12),
        ] {
            for storage in [Storage::Sixteen, Storage::Packed, Storage::Lossless] {
                for (width, height) in [(37, 23), (300, 270), (1, 1), (512, 16), (48, 23)] {
                    let raw = image(pattern, bits, width, height);
                    let mut file = Cursor::new(Vec::new());
                    write_image(&raw, storage, None, &mut file).unwrap();
                    file.set_position(0);
                    let back = read(&mut file).unwrap();
                    assert_eq!(back.mosaic.data, raw.mosaic.data, "{pattern} {storage:?} {width} × {height}");
                    assert_eq!(back.header.cfa, raw.header.cfa);
                    assert!(back.size() == [width, height] && back.header.warnings.is_empty());
                    assert_eq!(back.header.facts, raw.header.facts);
                    assert!((back.header.baseline_ev - raw.header.baseline_ev).abs() < 1e-6);
                    let close = |a: &[f64], b: &[f64]| a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-6 * (1.0 + b.abs()));
                    assert!(close(&back.header.as_shot_neutral, &raw.header.as_shot_neutral));
                    assert!(close(&[back.header.black_level, back.header.white_level], &[16.5, raw.header.white_level]));
                    assert_eq!(back.header.calibrations.len(), raw.header.calibrations.len());
                    for (a, b) in back.header.calibrations.iter().zip(&raw.header.calibrations) {
                        assert_eq!(a.light, b.light);
                        assert!(close(a.camera_from_xyz.as_flattened(), b.camera_from_xyz.as_flattened()));
                        assert!(close(a.xyz_d50_from_balanced.as_flattened(), b.xyz_d50_from_balanced.as_flattened()));
                    }
                    assert!(close(back.header.noise.as_flattened(), raw.header.noise.as_flattened()));
                }
            }
        }
    }

    /// A DNG of one strip with these fields besides: 16 bits, black 0, white 40 000, a camera whose channels are XYZ.
    fn tiny(size: [usize; 2], samples: usize, pixels: &[u8], fields: Vec<(u16, Field)>) -> Vec<u8> {
        let mut file = Cursor::new(Vec::new());
        let mut tiff = tiff::encoder::TiffEncoder::new(&mut file).unwrap();
        let mut directory = tiff.image_directory().unwrap();
        let place = directory.write_data(pixels).unwrap() as u32;
        if pixels.len() % 2 == 1 {
            directory.write_data(0u8).unwrap();
        }
        let photometric = if samples == 1 { photometric::CFA } else { photometric::LINEAR_RAW };
        let mut all = vec![
            (tag::NEW_SUBFILE_TYPE, Field::long(0)),
            (tag::WIDTH, Field::long(size[0] as u32)),
            (tag::HEIGHT, Field::long(size[1] as u32)),
            (tag::BITS_PER_SAMPLE, Field::Shorts(vec![16; samples])),
            (tag::COMPRESSION, Field::short(compression::NONE)),
            (tag::PHOTOMETRIC, Field::short(photometric)),
            (tag::STRIP_OFFSETS, Field::long(place)),
            (tag::SAMPLES_PER_PIXEL, Field::short(samples as u16)),
            (tag::ROWS_PER_STRIP, Field::long(size[1] as u32)),
            (tag::STRIP_BYTE_COUNTS, Field::long(pixels.len() as u32)),
            (tag::CFA_REPEAT, Field::Shorts(vec![2, 2])),
            (tag::CFA_PATTERN, Field::Bytes(vec![0, 1, 1, 2])),
            (tag::DNG_VERSION, Field::Bytes(vec![1, 4, 0, 0])),
            (tag::WHITE_LEVEL, Field::long(40_000)),
            (tag::COLOR_MATRIX[0], Field::SRationals(vec![1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0])),
            (tag::CALIBRATION_ILLUMINANT[0], Field::short(21)),
        ];
        all.retain(|(tag, _)| fields.iter().all(|f| f.0 != *tag));
        all.extend(fields);
        write_fields(&mut directory, &all).unwrap();
        directory.finish().unwrap();
        file.into_inner()
    }

    /// The same file as BigTIFF (little-endian): places of eight bytes, the directory behind the end.
    fn large(classic: &[u8]) -> Vec<u8> {
        let number = |at: usize, bytes: usize| classic[at..at + bytes].iter().rev().fold(0u64, |n, b| n << 8 | u64::from(*b));
        let directory = number(4, 4) as usize;
        let count = number(directory, 2);
        let mut all = [&b"II+\0\x08\0\0\0"[..], &(classic.len() as u64 + 8).to_le_bytes(), &classic[8..]].concat();
        all.extend(count.to_le_bytes());
        for entry in (0..count as usize).map(|k| directory + 2 + 12 * k) {
            let [tag, kind, values] = [number(entry, 2), number(entry + 2, 2), number(entry + 4, 4)];
            let bytes = values as usize * [1, 1, 1, 2, 4, 8, 1, 1, 2, 4, 8, 4, 8][kind as usize];
            let at = if bytes <= 4 { entry + 8 } else { number(entry + 8, 4) as usize };
            let mut told = if bytes <= 8 { classic[at..at + bytes].to_vec() } else { (at as u64 + 8).to_le_bytes().to_vec() };
            if tag == u64::from(tag::STRIP_OFFSETS) {
                told = (number(at, bytes) + 8).to_le_bytes()[..bytes].to_vec();
            }
            told.resize(8, 0);
            all.extend(classic[entry..entry + 4].iter().copied().chain(values.to_le_bytes()).chain(told));
        }
        all.extend([0; 8]);
        all
    }

    #[test]
    fn large_tiffs_are_read_as_classic_ones() {
        let dn: Vec<u16> = (0..8 * 4).map(|i| 300 * i).collect();
        let classic = tiny([8, 4], 1, &shorts(&dn), vec![white(vec![0.5, 1.0, 0.8])]);
        if !classic.starts_with(b"II") {
            return;
        }
        let [a, b] = [&classic, &large(&classic)].map(|file| read(Cursor::new(file.clone())).unwrap());
        assert_eq!(a.mosaic.data, b.mosaic.data);
        assert_eq!((a.header.white_level, &a.header.cfa), (b.header.white_level, &b.header.cfa));
        // Cut within its header, it is no file.
        assert!(read(Cursor::new(large(&classic)[..12].to_vec())).is_err());
    }

    #[test]
    fn filters_that_are_not_known_are_named() {
        let dn = shorts(&[1000; 8 * 4]);
        let emerald = vec![white(vec![1.0; 3]), (tag::CFA_PATTERN, Field::Bytes(vec![0, 1, 3, 5]))];
        let error = read(Cursor::new(tiny([8, 4], 1, &dn, emerald))).unwrap_err().to_string();
        assert!(error.contains("of red, green, cyan, yellow; expected red, green, blue and clear"), "{error}");
    }

    fn shorts(values: &[u16]) -> Vec<u8> {
        values.iter().flat_map(|v| v.to_ne_bytes()).collect()
    }

    fn white(values: Vec<f64>) -> (u16, Field) {
        (tag::AS_SHOT_NEUTRAL, Field::Rationals(values))
    }

    #[test]
    fn what_rows_have_more_of_black_is_missing_below_white() {
        let dn = vec![2000u16; 8 * 4];
        let levels = |black: f64| vec![white(vec![1.0, 1.0, 1.0]), (tag::BLACK_LEVEL, Field::Rationals(vec![black]))];
        let level = |fields| {
            let raw = read(Cursor::new(tiny([8, 4], 1, &shorts(&dn), fields))).unwrap();
            let (h, dn) = (&raw.header, f64::from(raw.mosaic.data[0]));
            (dn - h.black_level) / (h.white_level - h.black_level)
        };
        let plain = level(levels(200.0));
        let delta = (tag::BLACK_DELTA[1], Field::Rationals(vec![100.0; 4]));
        assert!((level([levels(100.0), vec![delta]].concat()) - plain).abs() < 1e-9);
        assert!((plain - 1800.0 / 39_800.0).abs() < 1e-9, "{plain}");
    }

    #[test]
    fn linear_files_are_read_with_all_their_samples() {
        let dn: Vec<u16> = (0..6 * 4 * 3).map(|i| 500 * (i % 70) as u16).collect();
        let area = (tag::ACTIVE_AREA, Field::Longs(vec![1, 2, 4, 6]));
        let black = (tag::BLACK_LEVEL, Field::Rationals(vec![100.0, 200.0, 300.0]));
        let crop = [(tag::CROP_ORIGIN, Field::Longs(vec![1, 0])), (tag::CROP_SIZE, Field::Longs(vec![2, 3]))];
        let fields = [vec![white(vec![0.5, 1.0, 0.8]), area, black], crop.to_vec()].concat();
        let raw = read(Cursor::new(tiny([6, 4], 3, &shorts(&dn), fields))).unwrap();
        assert!(raw.header.cfa.has_all_channels() && raw.size() == [4, 3] && raw.header.warnings.is_empty());
        assert_eq!(raw.header.framing.crop, Some([3, 0, 6, 3]));
        assert_eq!(raw.header.black_level, 200.0);
        for (x, y, c) in [(0, 0, 0), (3, 2, 2), (1, 1, 1)] {
            // What its own black has more than the mean is taken off.
            let told = f64::from(dn[((y + 1) * 6 + x + 2) * 3 + c]);
            let expected = (told - (100.0 * c as f64 - 100.0)).max(0.0);
            assert_eq!(f64::from(raw.mosaic.data[y * raw.mosaic.width + x * 3 + c]), expected, "{x} {y} {c}");
        }
        let error = |fields| read(Cursor::new(tiny([6, 4], 3, &shorts(&dn), fields))).unwrap_err().to_string();
        assert!(error(vec![(tag::PHOTOMETRIC, Field::short(photometric::CFA))]).contains("3 samples"));
        assert!(error(vec![(tag::PLANAR, Field::short(2))]).contains("PlanarConfiguration"));
        // A camera whose own calibration leaves no third colour: what was read could not be written and read again.
        let flat = vec![1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 1.0, 1.0, 0.0];
        assert!(error(vec![(tag::CAMERA_CALIBRATION[0], Field::SRationals(flat))]).contains("CameraCalibration1"));
        let far = vec![1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 3e4];
        assert!(error(vec![(tag::CAMERA_CALIBRATION[0], Field::SRationals(far))]).contains("CameraCalibration1"));
        assert!(error(vec![(tag::COMPRESSION, Field::short(compression::JPEG_XL))]).contains("JPEG XL"));
    }

    #[test]
    fn fields_that_stand_side_by_side_are_put_together() {
        // The four pictures of a Bayer mosaic of 5 × 3, as converters to JPEG XL lay them out.
        let fields = [[0u16, 2, 4, 1, 3], [20, 22, 24, 21, 23], [10, 12, 14, 11, 13]].concat();
        let factors = vec![
            (tag::ROW_INTERLEAVE_FACTOR, Field::short(2)),
            (tag::COLUMN_INTERLEAVE_FACTOR, Field::short(2)),
            white(vec![1.0; 3]),
        ];
        let raw = read(Cursor::new(tiny([5, 3], 1, &shorts(&fields), factors))).unwrap();
        assert_eq!(raw.mosaic.data, [[0, 1, 2, 3, 4], [10, 11, 12, 13, 14], [20, 21, 22, 23, 24]].concat());
        // Three samples a pixel move together, and factors larger than the picture are no more than it.
        let pixels: Vec<u16> = (0..4 * 3).collect();
        let factors = vec![(tag::COLUMN_INTERLEAVE_FACTOR, Field::long(u32::MAX)), white(vec![1.0; 3])];
        let raw = read(Cursor::new(tiny([4, 1], 3, &shorts(&pixels), factors.clone()))).unwrap();
        assert_eq!(raw.mosaic.data, pixels);
        // A whole file in JPEG XL.
        let bare = include_bytes!("../../tests/data/mosaic-lossless.jxl");
        let fields = vec![(tag::COMPRESSION, Field::short(compression::JPEG_XL)), white(vec![1.0; 3])];
        let raw = read(Cursor::new(tiny([24, 16], 1, bare, fields))).unwrap();
        assert_eq!((raw.size(), raw.mosaic.data[383]), ([24, 16], (383 * 2503 % 65_521) as u16));
    }

    #[test]
    fn opcodes_are_applied_where_they_belong() {
        use opcode::tests::{corners, doubles, floats, list_of, longs, opcode};
        // One bad pixel in a grey field (list 1), corners that are dark by half (list 2), a warp and a factor for later (list 3).
        let mut dn = vec![10_000u16; 8 * 6];
        dn[2 * 8 + 3] = 0;
        let all = longs(&[0, 0, 6, 8, 0, 1, 1, 1]);
        let first = list_of(&[opcode(4, false, &longs(&[0, 0]))]);
        let second = list_of(&[
            opcode(9, false, &corners([8, 6], [1.0, 2.0, 1.0, 2.0])),
            opcode(8, true, &[all.clone(), longs(&[1]), doubles(&[0.0, 0.5])].concat()),
            opcode(99, false, &[]),
            opcode(6, false, &longs(&[1, 1, 6, 8])),
        ]);
        let warp = [longs(&[1]), doubles(&[0.99, 0.01, 0.0, 0.0, 0.0, 0.0, 0.5, 0.5])].concat();
        let third = list_of(&[
            opcode(12, false, &[all, longs(&[6]), floats(&[2.0; 6])].concat()),
            opcode(1, false, &warp),
            opcode(1, false, &warp),
        ]);
        let lists = [first, second, third];
        let mut fields = vec![white(vec![1.0; 3]), (tag::DEFAULT_SCALE, Field::Rationals(vec![1.0, 2.0]))];
        fields.extend(lists.into_iter().enumerate().map(|(k, l)| (tag::OPCODE_LIST[k], Field::Undefined(l))));
        let raw = read(Cursor::new(tiny([8, 6], 1, &shorts(&dn), fields.clone()))).unwrap();
        let h = &raw.header;
        for (x, y) in [(0, 0), (3, 2), (7, 5)] {
            let value = (f64::from(raw.mosaic.pixel(x, y)[0]) - h.black_level) / (h.white_level - h.black_level);
            let expected = 0.25 * 0.5 * (1.0 + (x as f64 + 0.5) / 8.0);
            assert!((value - expected).abs() < 2e-5, "{x} {y}: {value} {expected}");
        }
        assert_eq!(h.framing, crate::raw::Framing { crop: Some([1, 1, 7, 5]), scale: [1.0, 2.0], ..Default::default() });
        assert_eq!(h.opcodes.iter().map(|o| o.to_string()).collect::<Vec<_>>(), ["ScalePerRow", "WarpRectilinear"]);
        assert_eq!(h.warnings.len(), 2, "{:?}", h.warnings);
        assert!(h.warnings[0].contains("opcode 99") && h.warnings[1].contains("one warp"), "{:?}", h.warnings);
        // Damage to a list is an error that names it.
        fields.pop();
        fields.push((tag::OPCODE_LIST[2], Field::Undefined(vec![0, 0, 0, 9, 1])));
        let error = read(Cursor::new(tiny([8, 6], 1, &shorts(&dn), fields))).unwrap_err().to_string();
        assert!(error.contains("OpcodeList3") && error.contains("opcode 1 of 9"), "{error}");
    }

    #[test]
    fn what_files_say_of_colors_and_crops_counts_or_is_told() {
        let read = |samples: usize, fields: Vec<(u16, Field)>| {
            super::read(Cursor::new(tiny([4, 4], samples, &shorts(&vec![1000; 16 * samples]), fields)))
        };
        let plain = read(1, vec![white(vec![1.0; 3])]).unwrap().header;
        assert!(plain.warnings.is_empty(), "{:?}", plain.warnings);
        // A chromaticity between both calibrations: the camera sees twice the red of the warm one's XYZ in the light of A, as much as XYZ in D65.
        let twice = vec![2.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0];
        let at = |[x, y]: [f64; 2]| {
            let fields = vec![
                (tag::COLOR_MATRIX[0], Field::SRationals(twice.clone())),
                (tag::CALIBRATION_ILLUMINANT[0], Field::short(17)),
                (tag::COLOR_MATRIX[1], Field::SRationals(vec![1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0])),
                (tag::CALIBRATION_ILLUMINANT[1], Field::short(21)),
                (tag::AS_SHOT_WHITE_XY, Field::Rationals(vec![x, y])),
            ];
            let neutral = read(1, fields).unwrap().header.as_shot_neutral;
            // Of red over green, relative to XYZ.
            neutral[0] / neutral[1] * y / x
        };
        // A, D65, and 3968 K between them by reciprocal temperature (CIE 15; Kim et al. 2002).
        let [warm, cool, between] = [[0.44757, 0.40745], [0.31272, 0.32903], [0.3825, 0.3838]].map(at);
        assert!(
            (warm - 2.0).abs() < 0.01 && (cool - 1.0).abs() < 0.01 && (between - 1.5).abs() < 0.05,
            "{warm} {cool} {between}"
        );
        // No colours come by a matrix of zeros, and the brightness of the profile counts.
        let zeros = (tag::FORWARD_MATRIX[0], Field::SRationals(vec![0.0; 9]));
        let header = read(1, vec![white(vec![1.0; 3]), zeros]).unwrap().header;
        assert!(header.calibrations[0].xyz_d50_from_balanced.is_empty() && header.warnings[0].contains("ForwardMatrix1"));
        let offset = (tag::BASELINE_EXPOSURE_OFFSET, Field::SRationals(vec![1.0]));
        assert!((read(1, vec![white(vec![1.0; 3]), offset]).unwrap().header.baseline_ev - plain.baseline_ev - 1.0).abs() < 1e-9);
        let crop = (tag::DEFAULT_USER_CROP, Field::Rationals(vec![0.25, 0.25, 0.75, 0.75]));
        assert!(read(1, vec![white(vec![1.0; 3]), crop]).unwrap().header.warnings[0].contains("DefaultUserCrop"));
        let whites = (tag::WHITE_LEVEL, Field::Longs(vec![65_535, 32_768, 65_535]));
        assert!(read(3, vec![white(vec![1.0; 3]), whites]).unwrap().header.warnings[0].contains("WhiteLevel"));
        for (field, word) in [
            ((tag::CFA_LAYOUT, Field::short(2)), "CFALayout"),
            ((tag::CFA_PLANE_COLOR, Field::Bytes(vec![2, 1, 0])), "CFAPlaneColor"),
        ] {
            let e = read(1, vec![white(vec![1.0; 3]), field]).unwrap_err().to_string();
            assert!(e.contains(word), "{e}");
        }
    }

    #[test]
    fn files_that_do_not_tell_their_white_are_of_daylight() {
        let raw = read(Cursor::new(tiny([4, 4], 1, &shorts(&[1000; 16]), vec![]))).unwrap();
        // White of D55 in XYZ, largest 1 (CIE 15: X 95.68, Z 92.14).
        let off = raw.header.as_shot_neutral.iter().zip([0.9568, 1.0, 0.9214]).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        assert!(off < 1e-3, "{:?}", raw.header.as_shot_neutral);
        assert!(raw.header.warnings.len() == 1 && raw.header.warnings[0].contains("daylight"), "{:?}", raw.header.warnings);
    }

    #[test]
    fn floating_point_files_get_numbers_of_16_bits() {
        let values: Vec<f32> = (0..12).map(|i| i as f32 / 11.0 * 2.0 - 0.01).collect();
        let bytes: Vec<u8> = values.iter().flat_map(|v| v.to_ne_bytes()).collect();
        let fields = vec![
            white(vec![1.0; 3]),
            (tag::BITS_PER_SAMPLE, Field::Shorts(vec![32; 3])),
            (tag::SAMPLE_FORMAT, Field::Shorts(vec![3; 3])),
            (tag::WHITE_LEVEL, Field::long(2)),
        ];
        let raw = read(Cursor::new(tiny([2, 2], 3, &bytes, fields))).unwrap();
        let h = &raw.header;
        for (dn, v) in raw.mosaic.data.iter().zip(&values) {
            let got = (f64::from(*dn) - h.black_level) / (h.white_level - h.black_level);
            assert!((got - f64::from(*v) / 2.0).abs() < 1e-5, "{got} {v}");
        }
        assert_eq!(h.warnings.len(), 1);
    }

    #[test]
    fn no_tile_is_wider_than_the_picture() {
        // LibRaw and dcraw would break its rows at the width of the picture.
        let written = |width: usize, storage: Storage| {
            let mut file = Cursor::new(Vec::new());
            write_image(&image("RG/GB", 14, width, 60), storage, None, &mut file).unwrap();
            file.into_inner()
        };
        for (width, is_packed) in [(200, true), (90, true), (208, false), (64, false), (300, false)] {
            let same = written(width, Storage::Lossless) == written(width, Storage::Packed);
            assert_eq!(same, is_packed, "{width}");
        }
    }

    #[test]
    fn more_pixels_than_the_bytes_can_become_are_refused() {
        for storage in [Storage::Sixteen, Storage::Packed, Storage::Lossless] {
            let mut file = Cursor::new(Vec::new());
            write_image(&image("RG/GB", 14, 64, 40), storage, None, &mut file).unwrap();
            let mut bytes = file.into_inner();
            // Fields of directories: tag, type, count of one, value. The picture becomes one part of 30000 × 30000.
            for at in (8..bytes.len() - 12).step_by(2) {
                let short = |i: usize| u16::from_le_bytes([bytes[at + i], bytes[at + i + 1]]);
                let (name, count, value) = (short(0), short(4), short(8));
                let size = [tag::WIDTH, tag::HEIGHT].contains(&name) && [64, 40].contains(&value);
                let part = [tag::TILE_WIDTH, tag::TILE_LENGTH, tag::ROWS_PER_STRIP].contains(&name);
                if (size || part) && [3, 4].contains(&short(2)) && count == 1 {
                    bytes[at + 2..at + 4].copy_from_slice(&[4, 0]);
                    bytes[at + 8..at + 12].copy_from_slice(&30_000u32.to_le_bytes());
                }
            }
            let e = read(Cursor::new(bytes)).unwrap_err().to_string();
            assert!(e.contains("announced"), "{storage:?}: {e}");
        }
    }

    #[test]
    fn the_lens_of_a_zoom_is_its_range() {
        use tiff::decoder::ifd::Value;
        let written = |range: Option<[[f64; 2]; 2]>| {
            let mut raw = image("RG/GB", 12, 16, 16);
            (raw.header.facts.focal_length_mm, raw.header.facts.lens_range) = (32.0, range);
            let mut file = Cursor::new(Vec::new());
            write_image(&raw, Storage::Sixteen, None, &mut file).unwrap();
            let mut decoder = tiff::decoder::Decoder::new(Cursor::new(file.into_inner())).unwrap();
            let found = decoder.find_tag(tiff::tags::Tag::from_u16_exhaustive(tag::LENS_INFO)).unwrap().unwrap();
            let Value::List(numbers) = found else { panic!("four numbers") };
            let number = |v: &Value| match v {
                Value::Rational(n, d) => f64::from(*n) / f64::from(*d),
                other => panic!("{other:?}"),
            };
            numbers.iter().map(number).collect::<Vec<f64>>()
        };
        assert_eq!(written(Some([[18.0, 3.5], [55.0, 5.6]])), [18.0, 55.0, 3.5, 5.6]);
        assert_eq!(written(None), [32.0, 32.0, 2.828, 2.828]);
    }

    #[test]
    fn files_cut_short_or_damaged_are_errors() {
        for storage in [Storage::Sixteen, Storage::Packed, Storage::Lossless] {
            let mut file = Cursor::new(Vec::new());
            write_image(&image("RG/GB", 14, 64, 40), storage, None, &mut file).unwrap();
            let bytes = file.into_inner();
            for length in (0..bytes.len()).step_by(bytes.len() / 60) {
                assert!(read(Cursor::new(&bytes[..length])).is_err(), "{storage:?} {length}");
            }
            // Single damaged bytes may pass unseen (pixels do), but never panic.
            for place in 0..bytes.len().min(3000) {
                for value in [0, 0x7f, 0xff] {
                    let mut damaged = bytes.clone();
                    damaged[place] = value;
                    let _ = read(Cursor::new(&damaged));
                    let end = bytes.len() - 1 - place;
                    damaged[end] ^= value;
                    let _ = read(Cursor::new(&damaged));
                }
            }
        }
    }
}

use super::*;

/// The bytes of an opcode: id, whether it is optional, and its numbers.
pub fn opcode(id: u32, optional: bool, parameters: &[u8]) -> Vec<u8> {
    let head = [id, 0x0103_0000, u32::from(optional), parameters.len() as u32];
    [&longs(&head)[..], parameters].concat()
}

/// The bytes of a list.
pub fn list_of(opcodes: &[Vec<u8>]) -> Vec<u8> {
    [longs(&[opcodes.len() as u32]), opcodes.concat()].concat()
}

pub fn longs(values: &[u32]) -> Vec<u8> {
    values.iter().flat_map(|v| v.to_be_bytes()).collect()
}

pub fn doubles(values: &[f64]) -> Vec<u8> {
    values.iter().flat_map(|v| v.to_be_bytes()).collect()
}

pub fn floats(values: &[f32]) -> Vec<u8> {
    values.iter().flat_map(|v| v.to_be_bytes()).collect()
}

/// A gain map of all of a picture: factors `[row][column]` at its corners.
pub fn corners(size: [u32; 2], factors: [f32; 4]) -> Vec<u8> {
    let area = longs(&[0, 0, size[1], size[0], 0, 1, 1, 1]);
    let grid = [longs(&[2, 2]), doubles(&[1.0, 1.0, 0.0, 0.0]), longs(&[1])].concat();
    [area, grid, floats(&factors)].concat()
}

fn one(id: u32, parameters: &[u8], number: usize) -> Opcode {
    let mut warnings = Vec::new();
    let mut all = list(&list_of(&[opcode(id, false, parameters)]), number, false, &mut warnings).unwrap();
    assert!(warnings.is_empty() && all.len() == 1);
    all.remove(0)
}

#[test]
fn gain_maps_are_bilinear_over_the_picture() {
    let map = one(9, &corners([10, 20], [1.0, 2.0, 3.0, 4.0]), 2);
    for (x, y) in [(0, 0), (9, 0), (4, 13), (9, 19)] {
        // Middles of pixels, of the sides.
        let (u, v) = ((x as f32 + 0.5) / 10.0, (y as f32 + 0.5) / 20.0);
        let expected = 0.5 * (1.0 + u + 2.0 * v);
        let got = map.value([10, 20], 0, [x, y], 0.5);
        assert!((got - expected).abs() < 1e-6, "{x} {y}: {got} {expected}");
    }
    // Another plane is not of its area.
    assert_eq!(map.value([10, 20], 1, [3, 3], 0.5), 0.5);
}

#[test]
fn every_kind_of_value_is_what_the_specification_says() {
    let area = longs(&[2, 1, 6, 9, 0, 1, 2, 3]);
    let with = |rest: &[u8]| [&area[..], rest].concat();
    let size = [10, 8];
    // Rows 2 and 4, columns 1, 4 and 7.
    let rows = with(&[longs(&[2]), floats(&[655.35, -1310.7])].concat());
    let columns = with(&[longs(&[3]), floats(&[2.0, 3.0, 4.0])].concat());
    let near = |got: f32, expected: f32| assert!((got - expected).abs() < 1e-5, "{got} {expected}");
    near(one(10, &rows, 2).value(size, 0, [4, 2], 0.5), 0.51);
    near(one(10, &rows, 2).value(size, 0, [4, 4], 0.5), 0.48);
    near(one(10, &rows, 2).value(size, 0, [4, 3], 0.5), 0.5);
    near(one(10, &rows, 2).value(size, 0, [5, 4], 0.5), 0.5);
    near(one(13, &columns, 2).value(size, 0, [7, 4], 0.1), 0.4);
    near(one(13, &columns, 2).value(size, 0, [8, 4], 0.1), 0.1);
    // x + 2 x² of shares, and of numbers; mirrored below 0.
    let square = with(&[longs(&[2]), doubles(&[0.0, 1.0, 2.0])].concat());
    near(one(8, &square, 2).value(size, 0, [1, 2], 0.25), 0.375);
    near(one(8, &square, 2).value(size, 0, [1, 2], -0.25), -0.375);
    let number = 10.0 / SHORT;
    near(one(8, &square, 1).value(size, 0, [1, 2], number) * SHORT, 210.0);
    // A table whose last entry goes on.
    let table = with(&[longs(&[3]), [0u16, 100, 50].iter().flat_map(|v| v.to_be_bytes()).collect()].concat());
    near(one(7, &table, 1).value(size, 0, [1, 2], 1.0 / SHORT) * SHORT, 100.0);
    near(one(7, &table, 1).value(size, 0, [1, 2], 0.9) * SHORT, 50.0);
    // Radii are of the furthest corner.
    let vignette = one(3, &doubles(&[0.5, 0.25, 0.0, 0.0, 0.0, 0.5, 0.5]), 3);
    near(vignette.value([11, 21], 0, [0, 0], 0.4), 0.4 * 1.75);
    near(vignette.value([11, 21], 2, [5, 10], 0.4), 0.4);
}

#[test]
fn warps_move_pixels_as_the_specification_says() {
    let size = [101, 81];
    let radial = [longs(&[1]), doubles(&[0.98, 0.03, -0.01, 0.002, 0.0, 0.0, 0.5, 0.5])].concat();
    let Action::Warp(warp) = one(1, &radial, 3).action else { panic!("a warp") };
    let unit = 50f64.hypot(40.0);
    let r = 30.0 / unit;
    let factor = 0.98 + 0.03 * r.powi(2) - 0.01 * r.powi(4) + 0.002 * r.powi(6);
    let [x, y] = warp.source(size, 2, [80.0, 40.0]);
    assert!((x - (50.0 + 30.0 * factor)).abs() < 1e-9 && (y - 40.0).abs() < 1e-9, "{x} {y}");
    assert!(warp.reach(size) < 0.02);
    let tangential = [longs(&[1]), doubles(&[1.0, 0.0, 0.0, 0.0, 0.01, 0.02, 0.5, 0.5])].concat();
    let Action::Warp(warp) = one(1, &tangential, 3).action else { panic!("a warp") };
    let [x, y] = warp.source(size, 0, [80.0, 60.0]);
    let (dx, dy) = (30.0 / unit, 20.0 / unit);
    let r2 = dx * dx + dy * dy;
    assert!((x - 80.0 - unit * (0.01 * 2.0 * dx * dy + 0.02 * (r2 + 2.0 * dx * dx))).abs() < 1e-9, "{x}");
    assert!((y - 60.0 - unit * (0.02 * 2.0 * dx * dy + 0.01 * (r2 + 2.0 * dy * dy))).abs() < 1e-9, "{y}");
    // A fisheye whose terms are those of the tangent is none.
    let fisheye = [longs(&[1]), doubles(&[1.0, 1.0 / 3.0, 2.0 / 15.0, 17.0 / 315.0, 0.5, 0.5])].concat();
    let Action::Warp(warp) = one(2, &fisheye, 3).action else { panic!("a warp") };
    let [x, _] = warp.source(size, 0, [60.0, 40.0]);
    assert!((x - 60.0).abs() < 1e-4, "{x}");
    let wild = [longs(&[1]), doubles(&[1e9, 0.0, 0.0, 0.0, 0.0, 0.0, 0.5, 0.5])].concat();
    let Action::Warp(warp) = one(1, &wild, 3).action else { panic!("a warp") };
    assert!(warp.reach(size) > 1.0);
}

#[test]
fn bad_pixels_take_the_mean_of_their_colour() {
    let cfa = Cfa::parse("RG/GB").unwrap();
    let size = [12, 10];
    let phase = [1, 0];
    let clean: Vec<f32> = (0..120).map(|i| 0.1 + 0.2 * cfa.channel_beyond((i % 12) as i64 - 1, (i / 12) as i64) as f32).collect();
    let mut data = clean.clone();
    for (row, column) in [(0, 0), (5, 6), (7, 2), (7, 3)] {
        data[row * 12 + column] = 0.0;
    }
    let points = longs(&[1, 2, 1, 0, 0, 5, 6, 7, 2, 8, 4]);
    let mut values = Values { data: data.clone(), size, cfa: &cfa, phase };
    values.apply(&[one(5, &points, 1)], &mut Vec::new());
    let worst = values.data.iter().zip(&clean).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
    assert!(worst < 1e-6, "{worst}");
    // By their number.
    let mut values = Values { data, size, cfa: &cfa, phase };
    values.apply(&[one(4, &longs(&[0, 0]), 1)], &mut Vec::new());
    assert!(values.data.iter().zip(&clean).all(|(a, b)| (a - b).abs() < 1e-6));
    // Where all is bad nothing can be done.
    let mut warnings = Vec::new();
    let mut values = Values { data: vec![0.0; 120], size, cfa: &cfa, phase };
    values.apply(&[one(4, &longs(&[0, 0]), 1)], &mut warnings);
    assert!(warnings.len() == 1 && warnings[0].contains("FixBadPixelsConstant"), "{warnings:?}");
}

#[test]
fn the_work_of_a_list_is_bounded() {
    let cfa = Cfa::parse("RG/GB").unwrap();
    let (size, phase) = ([12, 10], [0, 0]);
    let clean: Vec<f32> = (0..120).map(|i| i as f32 / 120.0).collect();
    let applied = |opcodes: &[Opcode]| {
        let mut warnings = Vec::new();
        let mut values = Values { data: clean.clone(), size, cfa: &cfa, phase };
        values.apply(opcodes, &mut warnings);
        (values.data, warnings)
    };
    // A thousand times all of the picture in 16 kilobytes; sides outside of it cost nothing.
    let whole: Vec<u8> = longs(&[1, 0, 1000]).into_iter().chain(longs(&[0, 0, u32::MAX, u32::MAX]).repeat(1000)).collect();
    let (data, warnings) = applied(&[one(5, &whole, 1)]);
    assert!(data == clean && warnings.len() == 1 && warnings[0].contains("larger than the picture"), "{warnings:?}");
    let outside = [longs(&[1, 0, 2000]), longs(&[20, 0, u32::MAX, 5]).repeat(2000)].concat();
    assert_eq!(applied(&[one(5, &outside, 1)]), (clean.clone(), vec![]));
    // A tenth of the picture may be bad, in one opcode or in two: 12 numbers, then 8 and 8.
    let row = |top: u32, columns: u32| one(5, &[longs(&[1, 0, 1]), longs(&[top, 0, top + 1, columns])].concat(), 1);
    assert!(applied(&[row(3, 12)]).1.is_empty());
    let (_, warnings) = applied(&[row(3, 8), row(7, 8)]);
    assert!(warnings.len() == 1 && warnings[0].contains("beside the 8"), "{warnings:?}");
    // And no list is longer than 256.
    let trim = opcode(6, false, &longs(&[0, 0, 4, 4]));
    let list_with = |count: usize| list(&list_of(&vec![trim.clone(); count]), 1, false, &mut Vec::new());
    assert_eq!(list_with(256).unwrap().len(), 256);
    let error = list_with(257).unwrap_err().to_string();
    assert!(error.contains("257 opcodes: expected at most 256"), "{error}");
}

#[test]
fn lists_are_held_against_their_bytes() {
    let fine = list_of(&[opcode(9, false, &corners([4, 4], [1.0; 4])), opcode(6, false, &longs(&[0, 0, 4, 4]))]);
    let mut warnings = Vec::new();
    assert_eq!(list(&fine, 2, false, &mut warnings).unwrap().len(), 2);
    for length in 0..fine.len() {
        assert!(list(&fine[..length], 2, false, &mut warnings).is_err(), "{length}");
    }
    // Every damaged byte is read or refused, never more.
    for place in 0..fine.len() {
        for value in [0, 1, 0x7f, 0xff] {
            let mut damaged = fine.clone();
            damaged[place] = value;
            for opcode in list(&damaged, 1, false, &mut Vec::new()).into_iter().flatten() {
                let _ = opcode.value([4, 4], 0, [3, 3], 0.5);
            }
        }
    }
    assert!(warnings.is_empty());
    // Damage to what may be left out is left out; what is unknown is told unless it may.
    let short = |optional| list_of(&[opcode(9, optional, &[0; 8])]);
    let error = list(&short(false), 2, false, &mut warnings).unwrap_err().to_string();
    assert!(error.contains("OpcodeList2") && error.contains("GainMap"), "{error}");
    assert!(list(&short(true), 2, false, &mut warnings).unwrap().is_empty() && warnings.is_empty());
    let unknown = |optional| list_of(&[opcode(14, optional, &[0; 8])]);
    assert!(list(&unknown(true), 3, false, &mut warnings).unwrap().is_empty() && warnings.is_empty());
    assert!(list(&unknown(false), 3, false, &mut warnings).unwrap().is_empty());
    assert!(warnings.len() == 1 && warnings[0].contains("WarpRectilinear2"), "{warnings:?}");
}

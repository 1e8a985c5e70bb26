use super::*;
use glam::Vec3;

const VERSION: u32 = 32 << 21 | 9 << 10;
const UPPER_AT: usize = GRID + TREE + ROOT + TILE;
const LOWER_AT: usize = UPPER_AT + UPPER;
const LEAF_AT: usize = LOWER_AT + LOWER;

fn put(bytes: &mut [u8], at: usize, value: &[u8]) {
    bytes[at..at + value.len()].copy_from_slice(value);
}

/// A grid of one leaf at (8, 0, −16), a tile of 7 at (16, 0, −16), places of half a metre from (1, 2, 3) on.
fn grid(kind: u32, leaf: &[u8]) -> Vec<u8> {
    let mut b = vec![0; LEAF_AT + leaf.len()];
    let size = b.len() as u64;
    let all: [(usize, &[u8]); 9] = [
        (0, b"NanoVDB1"),
        (16, &VERSION.to_le_bytes()),
        (32, &size.to_le_bytes()),
        (632, &2u32.to_le_bytes()),
        (636, &kind.to_le_bytes()),
        (GRID, &((LEAF_AT - GRID) as u64).to_le_bytes()),
        (GRID + 8, &((LOWER_AT - GRID) as u64).to_le_bytes()),
        (GRID + 16, &((UPPER_AT - GRID) as u64).to_le_bytes()),
        (GRID + 24, &(TREE as u64).to_le_bytes()),
    ];
    all.iter().for_each(|(at, v)| put(&mut b, *at, v));
    for k in 0..3 {
        put(&mut b, MAP + 88 + 32 * k, &0.5f64.to_le_bytes());
        put(&mut b, MAP + 232 + 8 * k, &(1.0 + k as f64).to_le_bytes());
        put(&mut b, GRID + 32 + 4 * k, &1u32.to_le_bytes());
    }
    let root = GRID + TREE;
    for (k, v) in [8, 0, -16, 23, 7, -9].into_iter().enumerate() {
        put(&mut b, root + 4 * k, &i32::to_le_bytes(v));
    }
    put(&mut b, root + 24, &1u32.to_le_bytes());
    // x and y of the upper node are 0, z is −4096.
    put(&mut b, root + ROOT, &0xf_ffffu64.to_le_bytes());
    put(&mut b, root + ROOT + 8, &((UPPER_AT - root) as u64).to_le_bytes());
    // −16 is 4080 of 4096, in the last lower node, 112 in it.
    let lower = 31;
    put(&mut b, UPPER_AT + 4128 + lower / 8, &[1 << (lower % 8)]);
    put(&mut b, UPPER_AT + 8256 + 8 * lower, &((LOWER_AT - UPPER_AT) as u64).to_le_bytes());
    let [leaf_number, tile] = [1 << 8 | 14, 2 << 8 | 14];
    put(&mut b, LOWER_AT + 544 + leaf_number / 8, &[1 << (leaf_number % 8)]);
    put(&mut b, LOWER_AT + 1088 + 8 * leaf_number, &((LEAF_AT - LOWER_AT) as u64).to_le_bytes());
    put(&mut b, LOWER_AT + 32 + tile / 8, &[1 << (tile % 8)]);
    put(&mut b, LOWER_AT + 1088 + 8 * tile, &7f32.to_le_bytes());
    put(&mut b, LEAF_AT, leaf);
    b
}

fn floats(value: impl Fn(usize) -> f32) -> Vec<u8> {
    let mut leaf = vec![0; LEAF_HEAD];
    (0..BLOCK).for_each(|i| leaf.extend(value(i).to_le_bytes()));
    leaf
}

/// A file of one grid with a name.
fn file(name: &str, kind: u32, codec: u16, grid: &[u8]) -> Vec<u8> {
    let data = match codec {
        1 => {
            use std::io::Write;
            let mut packed = flate2::write::ZlibEncoder::new(Vec::new(), flate2::Compression::fast());
            packed.write_all(grid).unwrap();
            let packed = packed.finish().unwrap();
            [&(packed.len() as u64).to_le_bytes()[..], &packed].concat()
        }
        // Two chunks, stored as they are (Blosc's flag 2).
        2 => {
            let (first, second) = grid.split_at(grid.len() / 3);
            let chunk = |part: &[u8]| {
                let (length, packed) = (part.len() as u32, part.len() as u32 + 16);
                let mut b = (u64::from(packed)).to_le_bytes().to_vec();
                b.extend([2, 1, 0x13, 4]);
                [length, length, packed].iter().for_each(|v| b.extend(v.to_le_bytes()));
                b.extend(part);
                b
            };
            [chunk(first), chunk(second)].concat()
        }
        _ => grid.to_vec(),
    };
    let mut b = vec![0; SEGMENT + METADATA];
    put(&mut b, 0, b"NanoVDB2");
    put(&mut b, 8, &VERSION.to_le_bytes());
    put(&mut b, 12, &1u16.to_le_bytes());
    put(&mut b, 14, &codec.to_le_bytes());
    put(&mut b, SEGMENT, &(grid.len() as u64).to_le_bytes());
    put(&mut b, SEGMENT + 8, &(data.len() as u64).to_le_bytes());
    put(&mut b, SEGMENT + 32, &kind.to_le_bytes());
    put(&mut b, SEGMENT + 36, &2u32.to_le_bytes());
    put(&mut b, SEGMENT + 136, &(name.len() as u32 + 1).to_le_bytes());
    put(&mut b, SEGMENT + 168, &codec.to_le_bytes());
    b.extend(name.bytes().chain([0]));
    b.extend(data);
    b
}

fn place(x: i32, y: i32, z: i32) -> Vec3 {
    IVec3::new(x, y, z).as_vec3() * 0.5 + Vec3::new(1.0, 2.0, 3.0)
}

#[test]
fn values_lie_where_the_map_puts_them() {
    let plain = grid(FLOAT, &floats(|i| i as f32));
    for codec in [0, 1, 2] {
        let bytes = file("density", FLOAT, codec, &plain);
        let all = File::open(&bytes).unwrap();
        assert_eq!(all.names().collect::<Vec<_>>(), ["density"]);
        assert!(all.read("temperature").is_none());
        let found = all.read("density").unwrap().unwrap();
        assert_eq!(found.negative, 0);
        let at = |x, y, z| found.values.at(place(x, y, z));
        assert_eq!([at(9, 3, -14), at(15, 7, -9)], [(1 << 6 | 3 << 3 | 2) as f32, 511.0]);
        assert_eq!([at(16, 0, -16), at(23, 7, -9), at(24, 7, -9), at(7, 0, -16)], [7.0, 7.0, 0.0, 0.0]);
        let b = found.values.bounds();
        assert!(b.min.abs_diff_eq(place(8, 0, -16), 1e-5) && b.max.abs_diff_eq(place(24, 8, -8), 1e-5), "{b:?}");
    }
}

#[test]
fn quantised_values_are_whole_steps_above_the_least() {
    let head = |bits_log2: u8| {
        let mut leaf = vec![0; LEAF_HEAD];
        leaf[15] = bits_log2 << 5;
        put(&mut leaf, 80, &0.5f32.to_le_bytes());
        put(&mut leaf, 84, &0.25f32.to_le_bytes());
        leaf
    };
    for (kind, bits) in [(FP4, 4usize), (FP8, 8), (FP16, 16), (FPN, 2), (FPN, 1)] {
        let code = |i: usize| (i * 7 + 3) & ((1 << bits) - 1);
        let mut leaf = head(bits.ilog2() as u8);
        let start = leaf.len();
        leaf.resize(start + BLOCK * bits / 8, 0);
        for i in 0..BLOCK {
            for b in 0..bits {
                leaf[start + (i * bits + b) / 8] |= ((code(i) >> b & 1) as u8) << ((i * bits + b) % 8);
            }
        }
        let bytes = file("d", kind, 0, &grid(kind, &leaf));
        let found = File::open(&bytes).unwrap().read("d").unwrap().unwrap();
        for i in [0usize, 1, 77, 300, 511] {
            let p = place(8 + (i >> 6) as i32, (i >> 3 & 7) as i32, -16 + (i & 7) as i32);
            assert!((found.values.at(p) - (0.5 + 0.25 * code(i) as f32)).abs() < 1e-3, "{kind} {bits} {i}");
        }
    }
}

#[test]
fn values_below_zero_are_counted_and_others_than_finite_refused() {
    let bytes = file("d", FLOAT, 0, &grid(FLOAT, &floats(|i| if i < 5 { -1.0 } else { 1.0 })));
    let found = File::open(&bytes).unwrap().read("d").unwrap().unwrap();
    assert_eq!((found.negative, found.values.at(place(8, 0, -16))), (5, 0.0));
    let bytes = file("d", FLOAT, 0, &grid(FLOAT, &floats(|_| f32::NAN)));
    assert!(File::open(&bytes).unwrap().read("d").unwrap().unwrap_err().found.contains("NaN"));
}

#[test]
fn broken_files_are_refused_wherever_they_end_or_are_changed() {
    let plain = grid(FLOAT, &floats(|i| i as f32));
    let whole = file("d", FLOAT, 0, &plain);
    let read = |bytes: &[u8]| File::open(bytes).and_then(|f| f.read("d").unwrap_or_else(|| Err(broken("no grid", ""))));
    assert!(read(&whole).is_ok());
    // Cut off anywhere.
    for i in 0..400 {
        let end = i * whole.len() / 400;
        assert!(end == 0 || read(&whole[..end]).is_err(), "{end}");
    }
    let start = whole.len() - plain.len();
    let root = start + GRID + TREE;
    let changed = |at: usize, value: &[u8]| {
        let mut bytes = whole.clone();
        put(&mut bytes, at, value);
        read(&bytes).expect_err("it is broken")
    };
    for (at, value, word) in [
        (0, &b"OpenVDB0"[..], "convert"),
        (8, &(28u32 << 21).to_le_bytes(), "version 28"),
        (SEGMENT + 32, &6u32.to_le_bytes(), "Vec3f"),
        (SEGMENT + 36, &1u32.to_le_bytes(), "level set"),
        (SEGMENT + 168, &2u16.to_le_bytes(), "announced"),
        (SEGMENT + 168, &3u16.to_le_bytes(), "codec 3"),
        (SEGMENT, &77u64.to_le_bytes(), "header"),
        (start + 636, &14u32.to_le_bytes(), "one kind"),
        (start + MAP + 88, &0f64.to_le_bytes(), "inverted"),
        (start + GRID + 32, &u32::MAX.to_le_bytes(), "nodes of level 0"),
        (start + GRID + 32, &0u32.to_le_bytes(), "more leaves"),
        (start + GRID + 24, &u64::MAX.to_le_bytes(), ""),
        (root + 12, &(-99i32).to_le_bytes(), "rise"),
        (root + 12, &(1i32 << 30).to_le_bytes(), "within"),
        (root + 24, &u32::MAX.to_le_bytes(), "announced"),
        (root + ROOT, &0u64.to_le_bytes(), "a leaf at"),
        (root + ROOT + 8, &(1u64 << 40).to_le_bytes(), "offset"),
    ] {
        let e = changed(at, value);
        assert!(format!("{} {}", e.found, e.expected).contains(word), "{at} {word}: {e:?}");
    }
    // Whatever byte of the headers is another, nothing panics.
    for at in (0..start + GRID + TREE + ROOT + TILE).step_by(3) {
        let mut bytes = whole.clone();
        bytes[at] ^= 0x81;
        let _ = read(&bytes);
    }
}

#[test]
fn media_of_pbrt_take_their_density_from_a_file() {
    let heat = file("heat", FLOAT, 0, &grid(FLOAT, &floats(|_| 1500.0)));
    let bytes = [file("density", FLOAT, 1, &grid(FLOAT, &floats(|_| 2.0))), heat].concat();
    let fetch = |name: &str| match name {
        "smoke.nvdb" => Ok(bytes.clone()),
        _ => Err("no such file".to_owned()),
    };
    let load = |parameters: &str| {
        let text = format!(
            "Camera \"perspective\" WorldBegin MakeNamedMedium \"m\" \"string type\" \"nanovdb\" {parameters}\nMediumInterface \"m\" \"\" Material \"interface\" Shape \"sphere\" \"float radius\" 30"
        );
        crate::load::pbrt::load(text.as_bytes(), "test.pbrt", &fetch).map_err(|e| e.to_string())
    };
    let filename = "\"string filename\" \"smoke.nvdb\"";
    let d = load(&format!("{filename} \"string temperaturename\" \"heat\" \"float Lescale\" 0.5")).unwrap();
    assert!(d.warnings.is_empty(), "{:?}", d.warnings);
    assert!(load("").unwrap_err().contains("filename"));
    assert!(load(&format!("{filename} \"string gridname\" \"fog\"")).unwrap_err().contains("density, heat"));
    assert!(load(&format!("{filename} \"string temperaturename\" \"fire\"")).unwrap_err().contains("density, heat"));
    assert!(load("\"string filename\" \"x.nvdb\"").unwrap_err().contains("no such file"));
}

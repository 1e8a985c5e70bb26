//! NanoVDB files (`.nvdb`): sparse grids of numbers, as OpenVDB's tools and pbrt's scenes have them.
//!
//! Read are files of ABI version 32 (OpenVDB 9 to 13), uncompressed, with zlib or with Blosc, and of their grids those of `Float` and of its quantised
//! forms `Fp4`, `Fp8`, `Fp16` and `FpN`. A grid is a tree: a root table, upper nodes of 32³ children, lower nodes of 16³, leaves of 8³ values; offsets
//! count in bytes from the node that holds them. All of it is little-endian. Checksums are not looked at.
//!
//! Every offset and every count is held against the bytes that are there. Nodes are read at most as often as their count in the header says, so
//! that offsets which meet in one node cost no more than the file is long.
//!
//! Sources: OpenVDB's `nanovdb/PNanoVDB.h` (offsets of all members) and `nanovdb/io/IO.h` (segments, codecs); K. Museth 2021, "NanoVDB: A GPU-Friendly
//! and Portable VDB Data Structure For Real-Time Rendering And Simulation".

use crate::load::blosc;
use crate::medium::{BLOCK, SparseGrid};
use glam::{Affine3A, DAffine3, DMat3, DVec3, IVec3};
use std::borrow::Cow;
use std::io::Read;

/// What is wrong with a file.
#[derive(Clone, Debug)]
pub struct Broken {
    /// What was found.
    pub found: String,
    /// What was expected instead.
    pub expected: String,
}

/// Numbers of a grid, none of them below 0.
#[derive(Clone, Debug)]
pub struct Numbers {
    /// The numbers, in the space of the file.
    pub values: SparseGrid,
    /// How many were below 0 before.
    pub negative: usize,
}

/// What a file says of its grids.
#[derive(Debug)]
pub struct File<'a> {
    grids: Vec<Entry<'a>>,
}

#[derive(Debug)]
struct Entry<'a> {
    name: String,
    kind: u32,
    class: u32,
    codec: u16,
    /// Bytes of the grid as it is in memory.
    size: u64,
    data: &'a [u8],
}

/// The ABI whose layout this is.
const MAJOR_VERSION: u32 = 32;
/// Bytes of a segment's header.
const SEGMENT: usize = 16;
/// Bytes of what is said of a grid before all grids.
const METADATA: usize = 176;
/// Bytes of the header of a grid.
const GRID: usize = 672;
/// Bytes of the header of its tree.
const TREE: usize = 64;
/// Place of the map between coordinates and the world in the header of a grid.
const MAP: usize = 296;
/// Bytes of a root without its table.
const ROOT: usize = 64;
/// Bytes of an entry of that.
const TILE: usize = 32;
/// Bytes of an upper node.
const UPPER: usize = 270_400;
/// Bytes of a lower node.
const LOWER: usize = 33_856;
/// Bytes of a leaf before its values.
const LEAF_HEAD: usize = 96;
/// Coordinates beyond this are no volume that anybody made: places there are coarser than a value in 32 bits.
const FARTHEST: i32 = 1 << 24;

fn broken(found: impl Into<String>, expected: impl Into<String>) -> Broken {
    Broken { found: found.into(), expected: expected.into() }
}

/// Bytes that are read by place.
#[derive(Clone, Copy)]
struct Bytes<'a>(&'a [u8]);

impl<'a> Bytes<'a> {
    fn part(self, at: usize, length: usize) -> Result<&'a [u8], Broken> {
        at.checked_add(length).and_then(|end| self.0.get(at..end)).ok_or_else(|| {
            broken(format!("{} bytes where {length} bytes at {at} are announced", self.0.len()), "a whole NanoVDB file")
        })
    }
    fn array<const N: usize>(self, at: usize) -> Result<[u8; N], Broken> {
        let mut out = [0; N];
        out.copy_from_slice(self.part(at, N)?);
        Ok(out)
    }
    fn u16(self, at: usize) -> Result<u16, Broken> {
        self.array(at).map(u16::from_le_bytes)
    }
    fn u32(self, at: usize) -> Result<u32, Broken> {
        self.array(at).map(u32::from_le_bytes)
    }
    fn u64(self, at: usize) -> Result<u64, Broken> {
        self.array(at).map(u64::from_le_bytes)
    }
    fn f32(self, at: usize) -> Result<f32, Broken> {
        self.array(at).map(f32::from_le_bytes)
    }
    fn f64(self, at: usize) -> Result<f64, Broken> {
        self.array(at).map(f64::from_le_bytes)
    }
    fn coordinates(self, at: usize) -> Result<IVec3, Broken> {
        let one = |k: usize| self.u32(at + 4 * k).map(|v| v as i32);
        Ok(IVec3::new(one(0)?, one(1)?, one(2)?))
    }
    /// The place of a child: an offset from a place.
    fn child(self, from: usize, at: usize) -> Result<usize, Broken> {
        let offset = self.u64(at)? as i64;
        let place = i64::try_from(from).ok().and_then(|f| f.checked_add(offset)).and_then(|p| usize::try_from(p).ok());
        place.filter(|p| *p < self.0.len()).ok_or_else(|| broken(format!("a node at offset {offset}"), "one within the grid"))
    }
}

/// Names of the kinds of grids that are refused, by number.
fn kind_name(kind: u32) -> String {
    let known = [
        "Unknown", "Float", "Double", "Int16", "Int32", "Int64", "Vec3f", "Vec3d", "Mask", "Half", "UInt32", "Bool", "RGBA8",
        "Fp4", "Fp8", "Fp16", "FpN", "Vec4f", "Vec4d", "Index", "OnIndex",
    ];
    known.get(kind as usize).map_or(format!("type {kind}"), |n| (*n).to_owned())
}

// Kinds of values by number.
const FLOAT: u32 = 1;
const FP4: u32 = 13;
const FP8: u32 = 14;
const FP16: u32 = 15;
const FPN: u32 = 16;
/// The class of surfaces.
const LEVEL_SET: u32 = 1;

/// Whether a version is one whose layout is known.
fn check_version(version: u32, of: &str) -> Result<(), Broken> {
    let (major, minor, patch) = (version >> 21, version >> 10 & 2047, version & 1023);
    match major == MAJOR_VERSION {
        true => Ok(()),
        false => Err(broken(
            format!("NanoVDB version {major}.{minor}.{patch} of {of}"),
            format!("version {MAJOR_VERSION}; `nanovdb_convert` of a current OpenVDB writes it from a .vdb file"),
        )),
    }
}

impl<'a> File<'a> {
    /// Reads what a file says of its grids, not yet their values. Fails where it is of another version, no NanoVDB file (such as a `.vdb`), or cut short.
    pub fn open(bytes: &'a [u8]) -> Result<Self, Broken> {
        let all = Bytes(bytes);
        let mut grids = Vec::new();
        let mut at = 0;
        while at < bytes.len() {
            let magic = all.array::<8>(at)?;
            if !matches!(&magic, b"NanoVDB0" | b"NanoVDB2") {
                let hint = "a NanoVDB file (.nvdb); `nanovdb_convert` makes one of a .vdb file";
                return Err(broken(format!("the bytes {magic:02x?} at {at}"), hint));
            }
            check_version(all.u32(at + 8)?, "the file")?;
            let count = all.u16(at + 12)?;
            at += SEGMENT;
            // All that is said of grids comes first, then the grids.
            let mut sizes = Vec::new();
            for _ in 0..count {
                let name_size = all.u32(at + 136)? as usize;
                let name = all.part(at + METADATA, name_size)?;
                let name = String::from_utf8_lossy(name.split(|b| *b == 0).next().unwrap_or(&[])).into_owned();
                sizes.push(all.u64(at + 8)?);
                let (kind, class, codec) = (all.u32(at + 32)?, all.u32(at + 36)?, all.u16(at + 168)?);
                grids.push(Entry { name, kind, class, codec, size: all.u64(at)?, data: &[] });
                at += METADATA + name_size;
            }
            let first = grids.len() - sizes.len();
            for (entry, size) in grids[first..].iter_mut().zip(sizes) {
                let size = usize::try_from(size).unwrap_or(usize::MAX);
                entry.data = all.part(at, size)?;
                at += size;
            }
        }
        Ok(File { grids })
    }

    /// Names of its grids.
    pub fn names(&self) -> impl Iterator<Item = &str> {
        self.grids.iter().map(|g| g.name.as_str())
    }

    /// The numbers of the first grid of a name; `None` if there is none.
    pub fn read(&self, name: &str) -> Option<Result<Numbers, Broken>> {
        let entry = self.grids.iter().find(|g| g.name == name)?;
        let named = |e: Broken| broken(format!("grid \"{name}\": {}", e.found), e.expected);
        Some(entry.read().map_err(named))
    }
}

impl<'a> Entry<'a> {
    fn bytes(&self) -> Result<Cow<'a, [u8]>, Broken> {
        let unpacked = match self.codec {
            0 => Cow::Borrowed(self.data),
            1 => {
                let all = Bytes(self.data);
                let packed = usize::try_from(all.u64(0)?).unwrap_or(usize::MAX);
                let mut out = Vec::new();
                let mut stream = flate2::read::ZlibDecoder::new(all.part(8, packed)?).take(self.size.saturating_add(1));
                stream.read_to_end(&mut out).map_err(|e| broken(format!("zlib: {e}"), "a whole compressed grid"))?;
                Cow::Owned(out)
            }
            2 => {
                // Chunks of up to 1 GiB, each after its length.
                let (all, mut at, mut out) = (Bytes(self.data), 0, Vec::new());
                while at < self.data.len() {
                    let packed = usize::try_from(all.u64(at)?).unwrap_or(usize::MAX);
                    let left = self.size.saturating_sub(out.len() as u64).min(1 << 31) as usize;
                    let chunk = all.part(at + 8, packed)?;
                    blosc::unpack(chunk, left, &mut out)
                        .map_err(|e| broken(e, "a whole compressed grid: `nanovdb_convert -z` packs it by ZIP"))?;
                    at += 8 + packed;
                }
                Cow::Owned(out)
            }
            other => return Err(broken(format!("codec {other}"), "none (0), ZIP (1) or Blosc (2)")),
        };
        match unpacked.len() as u64 == self.size {
            true => Ok(unpacked),
            false => Err(broken(format!("{} bytes of a grid", unpacked.len()), format!("{} as its header says", self.size))),
        }
    }

    fn read(&self) -> Result<Numbers, Broken> {
        if !matches!(self.kind, FLOAT | FP4 | FP8 | FP16 | FPN) {
            return Err(broken(format!("values of kind {}", kind_name(self.kind)), "Float, Fp4, Fp8, Fp16 or FpN"));
        }
        if self.class == LEVEL_SET {
            return Err(broken("a level set (a surface by distances)", "a fog volume; `sdfToFog` of OpenVDB's tools makes one"));
        }
        let bytes = self.bytes()?;
        let all = Bytes(&bytes);
        if !matches!(&all.array::<8>(0)?, b"NanoVDB0" | b"NanoVDB1") {
            return Err(broken("a grid that does not begin as one", "NanoVDB0 or NanoVDB1"));
        }
        check_version(all.u32(16)?, "the grid")?;
        let kind = all.u32(636)?;
        if kind != self.kind {
            return Err(broken(format!("{} in a grid of {}", kind_name(kind), kind_name(self.kind)), "one kind of values"));
        }
        Tree::open(all, kind)?.read()
    }
}

/// A tree of values, and how many of its nodes are still to be read.
struct Tree<'a> {
    all: Bytes<'a>,
    kind: u32,
    root: usize,
    /// Leaves, lower and upper nodes.
    left: [u32; 3],
    box_min: IVec3,
    box_max: IVec3,
    negative: usize,
    /// Blocks that tiles have filled.
    filled: usize,
}

impl<'a> Tree<'a> {
    fn open(all: Bytes<'a>, kind: u32) -> Result<Self, Broken> {
        all.part(GRID, TREE)?;
        let root = all.child(GRID, GRID + 24)?;
        let mut left = [0; 3];
        let smallest = [LEAF_HEAD, LOWER, UPPER];
        for k in 0..3 {
            left[k] = all.u32(GRID + 32 + 4 * k)?;
            if (left[k] as usize).saturating_mul(smallest[k]) > all.0.len() {
                let found = format!("{} nodes of level {k} in {} bytes", left[k], all.0.len());
                return Err(broken(found, format!("nodes of at least {} bytes", smallest[k])));
            }
        }
        let (box_min, box_max) = (all.coordinates(root)?, all.coordinates(root + 12)?);
        let near = |c: IVec3| c.to_array().iter().all(|v| (-FARTHEST..=FARTHEST).contains(v));
        if !(box_min.cmple(box_max).all() && near(box_min) && near(box_max)) {
            let found = format!("a grid from {box_min} to {box_max}");
            return Err(broken(found, format!("coordinates that rise, within ±{FARTHEST}: is the grid empty?")));
        }
        Ok(Tree { all, kind, root, left, box_min, box_max, negative: 0, filled: 0 })
    }

    /// Coordinates from places of the file's world.
    fn map(&self) -> Result<Affine3A, Broken> {
        let at = MAP + 88;
        let mut m = [0.0; 9];
        for (k, v) in m.iter_mut().enumerate() {
            *v = self.all.f64(at + 8 * k)?;
        }
        let shift = DVec3::new(self.all.f64(at + 144)?, self.all.f64(at + 152)?, self.all.f64(at + 160)?);
        // Rows in the file, columns here.
        let world_from_index = DAffine3 { matrix3: DMat3::from_cols_array(&m).transpose(), translation: shift };
        let index_from_world = world_from_index.inverse();
        let scaled = world_from_index.matrix3.determinant().abs() > 0.0;
        let single =
            Affine3A { matrix3: index_from_world.matrix3.as_mat3().into(), translation: index_from_world.translation.as_vec3a() };
        match scaled && single.is_finite() {
            true => Ok(single),
            false => Err(broken("a map that cannot be inverted", "a scale other than 0")),
        }
    }

    /// A value that is not below 0.
    fn value(&mut self, v: f32) -> Result<f32, Broken> {
        if !v.is_finite() {
            return Err(broken(format!("a value of {v}"), "finite numbers"));
        }
        self.negative += usize::from(v < 0.0);
        Ok(v.max(0.0))
    }

    /// Counts a node of a level.
    fn meet(&mut self, level: usize) -> Result<(), Broken> {
        let names = ["leaves", "lower nodes", "upper nodes"];
        match self.left[level].checked_sub(1) {
            Some(left) => {
                self.left[level] = left;
                Ok(())
            }
            None => Err(broken(format!("more {} than the header counts", names[level]), "each node once")),
        }
    }

    fn read(mut self) -> Result<Numbers, Broken> {
        let background = self.all.f32(self.root + 28)?;
        let background = self.value(background)?;
        let mut values = SparseGrid::new(self.map()?, self.box_min, self.box_max, background).map_err(|blocks| {
            let found = format!("a grid from {} to {}: {blocks} blocks of 8³ values", self.box_min, self.box_max);
            broken(found, "at most 67 108 864; is a value far away from the others?")
        })?;
        let tiles = self.all.u32(self.root + 24)? as usize;
        self.all.part(self.root + ROOT, tiles.saturating_mul(TILE))?;
        for i in 0..tiles {
            let at = self.root + ROOT + TILE * i;
            let origin = corner_of(self.all.u64(at)?);
            match self.all.u64(at + 8)? {
                0 => {
                    let active = self.all.u32(at + 16)? != 0;
                    self.tile(at + 20, active, origin, 1 << 12, &mut values)?;
                }
                _ => {
                    let upper = self.all.child(self.root, at + 8)?;
                    self.upper(upper, origin, &mut values)?;
                }
            }
        }
        Ok(Numbers { values, negative: self.negative })
    }

    fn upper(&mut self, node: usize, origin: IVec3, values: &mut SparseGrid) -> Result<(), Broken> {
        self.meet(2)?;
        self.all.part(node, UPPER)?;
        for i in 0..32_768usize {
            let place = origin + IVec3::new((i >> 10) as i32, (i >> 5 & 31) as i32, (i & 31) as i32) * 128;
            if self.bit(node + 4128, i)? {
                let lower = self.all.child(node, node + 8256 + 8 * i)?;
                self.lower(lower, place, values)?;
            } else {
                self.tile(node + 8256 + 8 * i, self.bit(node + 32, i)?, place, 128, values)?;
            }
        }
        Ok(())
    }

    fn lower(&mut self, node: usize, origin: IVec3, values: &mut SparseGrid) -> Result<(), Broken> {
        self.meet(1)?;
        self.all.part(node, LOWER)?;
        for i in 0..4096usize {
            let place = origin + IVec3::new((i >> 8) as i32, (i >> 4 & 15) as i32, (i & 15) as i32) * 8;
            if self.bit(node + 544, i)? {
                let leaf = self.all.child(node, node + 1088 + 8 * i)?;
                self.leaf(leaf, place, values)?;
            } else {
                self.tile(node + 1088 + 8 * i, self.bit(node + 32, i)?, place, 8, values)?;
            }
        }
        Ok(())
    }

    /// A cube of one value. What is neither active nor other than the background needs no room.
    fn tile(&mut self, at: usize, active: bool, place: IVec3, side: i32, values: &mut SparseGrid) -> Result<(), Broken> {
        if !active {
            return Ok(());
        }
        let v = self.all.f32(at)?;
        let v = self.value(v)?;
        self.filled += values.fill(place, side, v);
        match self.filled <= values.block_count() {
            true => Ok(()),
            false => Err(broken("tiles that overlap", "each place once")),
        }
    }

    fn bit(&self, mask: usize, i: usize) -> Result<bool, Broken> {
        Ok(self.all.array::<1>(mask + (i >> 3))?[0] >> (i & 7) & 1 != 0)
    }

    fn leaf(&mut self, node: usize, place: IVec3, values: &mut SparseGrid) -> Result<(), Broken> {
        self.meet(0)?;
        let mut block = [0.0; BLOCK];
        if self.kind == FLOAT {
            for (v, bytes) in block.iter_mut().zip(self.all.part(node + LEAF_HEAD, 4 * BLOCK)?.as_chunks::<4>().0) {
                *v = f32::from_le_bytes(*bytes);
            }
        } else {
            // Whole steps of a quantum above a least value.
            let (least, quantum) = (self.all.f32(node + 80)?, self.all.f32(node + 84)?);
            let bits = match self.kind {
                FP4 => 4,
                FP8 => 8,
                FP16 => 16,
                _ => 1usize << (self.all.array::<1>(node + 15)?[0] >> 5).min(4),
            };
            let codes = self.all.part(node + LEAF_HEAD, BLOCK * bits / 8)?;
            for (i, v) in block.iter_mut().enumerate() {
                let byte = usize::from(codes[i * bits / 8]);
                let code = match bits {
                    16 => byte | usize::from(codes[2 * i + 1]) << 8,
                    _ => byte >> (i * bits % 8) & ((1 << bits) - 1),
                };
                *v = code as f32 * quantum + least;
            }
        }
        for v in &mut block {
            *v = self.value(*v)?;
        }
        match values.set_block(place, &block) {
            true => Ok(()),
            false => Err(broken(format!("a leaf at {place}"), format!("leaves from {} to {}", self.box_min, self.box_max))),
        }
    }
}

/// The first coordinates of an upper node by its key: 21 bits for each axis, in nodes of 4096.
fn corner_of(key: u64) -> IVec3 {
    let axis = |shift: u32| ((key >> shift & 0x1f_ffff) as u32).wrapping_shl(12) as i32;
    IVec3::new(axis(42), axis(21), axis(0))
}

#[cfg(test)]
mod tests;

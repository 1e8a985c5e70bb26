//! The table of all items as a Parquet file: columns of numbers, truth values and text, each of which may be missing, plain and without compression.
//!
//! Source: Apache Parquet format 2.10 (`parquet.thrift`, "Encodings"), Apache Thrift compact protocol. One row group, data pages of version 1, definition
//! levels in run lengths. The usual crate (`parquet` of arrow-rs) would be the largest dependency of the program.

use serde_json::{Map, Value};
use std::collections::HashMap;

/// Rows of a page.
const PAGE_ROWS: usize = 65_536;
const MAGIC: &[u8] = b"PAR1";

/// A table that rows are added to.
#[derive(Debug, Default)]
pub struct Table {
    rows: usize,
    columns: Vec<(String, Column)>,
    places: HashMap<String, usize>,
}

/// Values of a column; those of the last rows may not be there yet.
#[derive(Debug)]
enum Column {
    /// Nothing but missing values so far.
    Empty,
    Bool(Vec<Option<bool>>),
    Whole(Vec<Option<i64>>),
    Number(Vec<Option<f64>>),
    Text(Vec<Option<String>>),
}

impl Column {
    /// Adds a value at a row; whole numbers become numbers, and all becomes text, where values of several kinds meet.
    fn write(&mut self, row: usize, value: &Value) {
        fn set<T>(values: &mut Vec<Option<T>>, row: usize, value: T) {
            values.resize_with(row, || None);
            values.push(Some(value));
        }
        if value.is_null() {
            return;
        }
        let rank = |c: &Column| match c {
            Column::Empty => 0,
            Column::Bool(_) => 1,
            Column::Whole(_) => 2,
            Column::Number(_) => 3,
            Column::Text(_) => 4,
        };
        let wanted = match value {
            Value::Bool(_) => 1,
            Value::Number(n) if n.is_i64() => 2,
            Value::Number(_) => 3,
            _ => 4,
        };
        let wanted = match (rank(self), wanted) {
            (0, wanted) => wanted,
            (held, wanted) if held == wanted => held,
            (2 | 3, 2 | 3) => 3,
            _ => 4,
        };
        if rank(self) != wanted {
            let held = std::mem::replace(self, Column::Empty);
            *self = match (held, wanted) {
                (Column::Empty, 1) => Column::Bool(Vec::new()),
                (Column::Empty, 2) => Column::Whole(Vec::new()),
                (Column::Empty, 3) => Column::Number(Vec::new()),
                (Column::Empty, _) => Column::Text(Vec::new()),
                (Column::Whole(all), 3) => Column::Number(all.into_iter().map(|v| v.map(|v| v as f64)).collect()),
                (Column::Bool(all), _) => Column::Text(all.into_iter().map(|v| v.map(|v| v.to_string())).collect()),
                (Column::Whole(all), _) => Column::Text(all.into_iter().map(|v| v.map(|v| v.to_string())).collect()),
                (Column::Number(all), _) => Column::Text(all.into_iter().map(|v| v.map(|v| v.to_string())).collect()),
                (text, _) => text,
            };
        }
        match self {
            Column::Empty => {}
            Column::Bool(all) => set(all, row, value.as_bool().unwrap_or_default()),
            Column::Whole(all) => set(all, row, value.as_i64().unwrap_or_default()),
            Column::Number(all) => set(all, row, value.as_f64().unwrap_or(f64::NAN)),
            Column::Text(all) => set(all, row, value.as_str().map_or_else(|| value.to_string(), str::to_owned)),
        }
    }

    /// Number of the type: BOOLEAN, INT32, INT64, DOUBLE, BYTE_ARRAY.
    fn kind(&self) -> i64 {
        match self {
            Column::Bool(_) => 0,
            // With the logical type UNKNOWN: readers take it for a column of any type.
            Column::Empty => 1,
            Column::Whole(_) => 2,
            Column::Number(_) => 5,
            Column::Text(_) => 6,
        }
    }

    /// The data of a page: definition levels, then the values that are there.
    fn page(&self, rows: std::ops::Range<usize>) -> Vec<u8> {
        fn of<'a, T>(all: &'a [Option<T>], rows: &std::ops::Range<usize>) -> impl Iterator<Item = Option<&'a T>> {
            let end = rows.end;
            rows.clone().map(move |r| all.get(r).filter(|_| r < end).and_then(Option::as_ref))
        }
        fn levels<'a, T: 'a>(values: impl Iterator<Item = Option<&'a T>>) -> Vec<u8> {
            let mut runs: Vec<(u64, u8)> = Vec::new();
            for value in values {
                let level = u8::from(value.is_some());
                match runs.last_mut().filter(|r| r.1 == level) {
                    Some(run) => run.0 += 1,
                    None => runs.push((1, level)),
                }
            }
            let mut bytes = Vec::new();
            for (count, level) in runs {
                varint(count << 1, &mut bytes);
                bytes.push(level);
            }
            let mut out = (bytes.len() as u32).to_le_bytes().to_vec();
            out.extend(bytes);
            out
        }
        match self {
            Column::Empty => levels::<i32>(rows.map(|_| None)),
            Column::Bool(all) => {
                let mut out = levels(of(all, &rows));
                for (k, value) in of(all, &rows).flatten().enumerate() {
                    if k % 8 == 0 {
                        out.push(0);
                    }
                    if let Some(last) = out.last_mut() {
                        *last |= u8::from(*value) << (k % 8);
                    }
                }
                out
            }
            Column::Whole(all) => {
                let mut out = levels(of(all, &rows));
                of(all, &rows).flatten().for_each(|v| out.extend(v.to_le_bytes()));
                out
            }
            Column::Number(all) => {
                let mut out = levels(of(all, &rows));
                of(all, &rows).flatten().for_each(|v| out.extend(v.to_le_bytes()));
                out
            }
            Column::Text(all) => {
                let mut out = levels(of(all, &rows));
                for text in of(all, &rows).flatten() {
                    out.extend((text.len() as u32).to_le_bytes());
                    out.extend(text.as_bytes());
                }
                out
            }
        }
    }
}

/// Unsigned LEB128.
fn varint(mut v: u64, to: &mut Vec<u8>) {
    while v >= 0x80 {
        to.push(v as u8 | 0x80);
        v >>= 7;
    }
    to.push(v as u8);
}

/// A structure in Thrift's compact protocol. Fields are added in the order of their numbers.
#[derive(Default)]
struct Struct {
    bytes: Vec<u8>,
    last: u8,
}

/// Thrift's numbers of types.
const I32: u8 = 5;
const I64: u8 = 6;
const BINARY: u8 = 8;
const LIST: u8 = 9;
const STRUCT: u8 = 12;

fn zigzag(v: i64, to: &mut Vec<u8>) {
    varint(((v << 1) ^ (v >> 63)) as u64, to);
}

impl Struct {
    fn field(&mut self, id: u8, kind: u8) {
        self.bytes.push(((id - self.last) << 4) | kind);
        self.last = id;
    }

    fn number(mut self, id: u8, kind: u8, v: i64) -> Self {
        self.field(id, kind);
        zigzag(v, &mut self.bytes);
        self
    }

    fn text(mut self, id: u8, text: &str) -> Self {
        self.field(id, BINARY);
        varint(text.len() as u64, &mut self.bytes);
        self.bytes.extend(text.as_bytes());
        self
    }

    fn nested(mut self, id: u8, inner: Struct) -> Self {
        self.field(id, STRUCT);
        self.bytes.extend(inner.end());
        self
    }

    /// A list of elements that are written already.
    fn list(mut self, id: u8, kind: u8, elements: Vec<Vec<u8>>) -> Self {
        self.field(id, LIST);
        match elements.len() {
            n @ 0..15 => self.bytes.push(((n as u8) << 4) | kind),
            n => {
                self.bytes.push(0xf0 | kind);
                varint(n as u64, &mut self.bytes);
            }
        }
        elements.iter().for_each(|e| self.bytes.extend(e));
        self
    }

    fn end(mut self) -> Vec<u8> {
        self.bytes.push(0);
        self.bytes
    }
}

impl Table {
    /// Adds a row; names that are new become columns.
    pub fn add(&mut self, row: Map<String, Value>) {
        for (name, value) in row {
            let columns = &mut self.columns;
            let place = *self.places.entry(name.clone()).or_insert_with(|| {
                columns.push((name, Column::Empty));
                columns.len() - 1
            });
            columns[place].1.write(self.rows, &value);
        }
        self.rows += 1;
    }

    /// The file.
    pub fn write(&self) -> Vec<u8> {
        self.write_by(concat!("diopter version ", env!("CARGO_PKG_VERSION")))
    }

    fn write_by(&self, created_by: &str) -> Vec<u8> {
        // What is a list in some rows and missing in the others has columns of its parts.
        let is_list =
            |name: &str| self.columns.iter().any(|(n, _)| n.strip_prefix(name).is_some_and(|rest| rest.starts_with('.')));
        let columns: Vec<_> = self.columns.iter().filter(|(n, c)| !matches!(c, Column::Empty) || !is_list(n)).collect();
        let mut out = MAGIC.to_vec();
        let root = Struct::default().text(4, "schema").number(5, I32, columns.len() as i64);
        let (mut schema, mut chunks, mut total) = (vec![root.end()], Vec::new(), 0);
        for (name, column) in columns {
            let begin = out.len();
            let pages = (0..self.rows).step_by(PAGE_ROWS).map(|first| first..(first + PAGE_ROWS).min(self.rows));
            for rows in pages {
                let values = rows.len() as i64;
                let data = column.page(rows);
                // Plain values, levels in run lengths (RLE).
                let of_data = Struct::default().number(1, I32, values).number(2, I32, 0).number(3, I32, 3).number(4, I32, 3);
                let size = data.len() as i64;
                let header = Struct::default().number(1, I32, 0).number(2, I32, size).number(3, I32, size).nested(5, of_data);
                out.extend(header.end());
                out.extend(data);
            }
            let bytes = (out.len() - begin) as i64;
            total += bytes;
            // Optional; text is UTF-8.
            let element = Struct::default().number(1, I32, column.kind()).number(3, I32, 1).text(4, name);
            let element = match column {
                Column::Empty => element.nested(10, Struct::default().nested(11, Struct::default())),
                Column::Text(_) => element.number(6, I32, 0),
                _ => element,
            };
            schema.push(element.end());
            let number = |v: i64| {
                let mut bytes = Vec::new();
                zigzag(v, &mut bytes);
                bytes
            };
            let mut path = Vec::new();
            varint(name.len() as u64, &mut path);
            path.extend(name.as_bytes());
            let meta = Struct::default()
                .number(1, I32, column.kind())
                .list(2, I32, vec![number(0), number(3)])
                .list(3, BINARY, vec![path])
                .number(4, I32, 0)
                .number(5, I64, self.rows as i64)
                .number(6, I64, bytes)
                .number(7, I64, bytes)
                .number(9, I64, begin as i64);
            chunks.push(Struct::default().number(2, I64, begin as i64).nested(3, meta).end());
        }
        let group = Struct::default().list(1, STRUCT, chunks).number(2, I64, total).number(3, I64, self.rows as i64);
        let footer = Struct::default()
            .number(1, I32, 1)
            .list(2, STRUCT, schema)
            .number(3, I64, self.rows as i64)
            .list(4, STRUCT, vec![group.end()])
            .text(6, created_by)
            .end();
        out.extend(&footer);
        out.extend((footer.len() as u32).to_le_bytes());
        out.extend(MAGIC);
        out
    }
}

#[cfg(test)]
mod tests {
    use super::super::sha256;
    use super::*;
    use serde_json::json;

    #[test]
    fn tables_are_those_that_pyarrow_reads() {
        let mut table = Table::default();
        for row in [
            json!({ "flash": true, "iso": 100, "key": "000000", "mixed": "f/2", "n": 1, "none": null }),
            json!({ "key": "000001", "mixed": 4, "n": 2 }),
            json!({ "flash": false, "iso": 1.5, "key": "000002", "n": -3 }),
        ] {
            table.add(row.as_object().unwrap().clone());
        }
        // Of a file whose like pyarrow 26, DuckDB and Polars read, the column without values with the type null (DuckDB, Polars: of whole numbers).
        assert_eq!(sha256::of_bytes(&table.write_by("test")), "2c5e6d8a5ea3230034eae64ec23ccf69c786424d3699d1c0284329975b6605ef");
    }

    #[test]
    fn kinds_of_values_meet_as_text() {
        let mut column = Column::Empty;
        [json!(null), json!(1), json!(2.5)].iter().enumerate().for_each(|(row, v)| column.write(row, v));
        assert!(matches!(&column, Column::Number(v) if *v == [None, Some(1.0), Some(2.5)]));
        column.write(4, &json!("auto"));
        assert!(
            matches!(&column, Column::Text(v) if v[2] == Some("2.5".into()) && v[3].is_none() && v[4] == Some("auto".into()))
        );
    }
}

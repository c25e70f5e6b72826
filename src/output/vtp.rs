//! ParaView files: polylines as VTK XML PolyData (`.vtp`) and their time series (`.pvd`).
//!
//! A filament is one polyline; ParaView's Tube filter with `Vary Radius = By Absolute Scalar` on
//! the point array `radius` shows it as it is. Arrays are appended raw, compressed with zlib in
//! blocks, all headers `UInt64` (VTK file formats, "XML file formats", section on appended data):
//! per array `[blocks][block size][size of the last, partial block][compressed sizes …]`, then the
//! blocks; offsets count from the underscore that opens the appended section.
use super::file::{OutputError, write_atomic};
use super::provenance::xml_comment;
use flate2::Compression;
use flate2::write::ZlibEncoder;
use glam::DVec3;
use std::fmt::Write as _;
use std::io::Write as _;
use std::path::Path;

/// Values of one array.
#[derive(Clone, Debug, PartialEq)]
pub enum Values {
    /// Double precision.
    F64(Vec<f64>),
    /// Single precision: enough for colours, half the size.
    F32(Vec<f32>),
    /// Integers.
    I64(Vec<i64>),
    /// A text (field data only).
    Text(String),
}

/// A named array.
#[derive(Clone, Debug, PartialEq)]
pub struct DataArray {
    /// Name with unit, as ParaView shows it.
    pub name: String,
    /// Components per point (1 or 3, 4 for quaternions).
    pub components: usize,
    /// The values, point by point.
    pub values: Values,
}

impl DataArray {
    /// One number per point, in single precision.
    pub fn scalars(name: impl Into<String>, values: impl IntoIterator<Item = f64>) -> Self {
        DataArray { name: name.into(), components: 1, values: Values::F32(values.into_iter().map(|v| v as f32).collect()) }
    }
    /// One vector per point, in single precision.
    pub fn vectors(name: impl Into<String>, values: impl IntoIterator<Item = DVec3>) -> Self {
        let values = values.into_iter().flat_map(|v| v.as_vec3().to_array()).collect();
        DataArray { name: name.into(), components: 3, values: Values::F32(values) }
    }
    /// One integer per point.
    pub fn integers(name: impl Into<String>, values: impl IntoIterator<Item = i64>) -> Self {
        DataArray { name: name.into(), components: 1, values: Values::I64(values.into_iter().collect()) }
    }
    /// A text.
    pub fn text(name: impl Into<String>, text: impl Into<String>) -> Self {
        DataArray { name: name.into(), components: 1, values: Values::Text(text.into()) }
    }
}

/// A set of polylines with data.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Polylines {
    /// All points, line after line.
    pub points: Vec<DVec3>,
    /// Number of points of each line, at least two.
    pub lengths: Vec<usize>,
    /// Arrays with one entry per point.
    pub point_data: Vec<DataArray>,
    /// Arrays with one entry per line.
    pub line_data: Vec<DataArray>,
    /// Arrays of the whole file: provenance and the like.
    pub field_data: Vec<DataArray>,
}

/// Uncompressed bytes per block: VTK's own default.
const BLOCK: usize = 32768;

/// The appended section and the offsets into it.
#[derive(Default)]
struct Appended(Vec<u8>);

impl Appended {
    /// Appends an array and returns its offset.
    fn push(&mut self, bytes: &[u8]) -> usize {
        let offset = self.0.len();
        let packed: Vec<Vec<u8>> = bytes
            .chunks(BLOCK)
            .map(|c| {
                let mut z = ZlibEncoder::new(Vec::with_capacity(c.len() / 2), Compression::fast());
                z.write_all(c).and_then(|()| z.finish()).expect("writing to memory does not fail")
            })
            .collect();
        let mut word = |w: usize| self.0.extend_from_slice(&(w as u64).to_le_bytes());
        word(packed.len());
        word(BLOCK);
        word(bytes.len() % BLOCK);
        packed.iter().for_each(|p| word(p.len()));
        packed.iter().for_each(|p| self.0.extend_from_slice(p));
        offset
    }
}

fn bytes_of(values: &Values) -> (&'static str, Vec<u8>) {
    match values {
        Values::F64(v) => ("Float64", v.iter().flat_map(|x| x.to_le_bytes()).collect()),
        Values::F32(v) => ("Float32", v.iter().flat_map(|x| x.to_le_bytes()).collect()),
        Values::I64(v) => ("Int64", v.iter().flat_map(|x| x.to_le_bytes()).collect()),
        Values::Text(s) => ("String", s.bytes().chain([0]).collect()),
    }
}

fn escape(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

fn array(xml: &mut String, appended: &mut Appended, a: &DataArray, tuples: Option<usize>) {
    let (kind, bytes) = bytes_of(&a.values);
    let offset = appended.push(&bytes);
    let tuples = tuples.map_or(String::new(), |n| format!(" NumberOfTuples=\"{n}\""));
    let _ = writeln!(
        xml,
        "<DataArray type=\"{kind}\" Name=\"{}\" NumberOfComponents=\"{}\"{tuples} format=\"appended\" offset=\"{offset}\"/>",
        escape(&a.name),
        a.components
    );
}

/// The bytes of a `.vtp` file at time `time`.
pub fn encode(lines: &Polylines, time: f64) -> Vec<u8> {
    let mut data = Appended::default();
    let mut x = String::from("<?xml version=\"1.0\"?>\n");
    x += "<VTKFile type=\"PolyData\" version=\"1.0\" byte_order=\"LittleEndian\" header_type=\"UInt64\" compressor=\"vtkZLibDataCompressor\">\n";
    x += "<PolyData>\n<FieldData>\n";
    let now = DataArray { name: "TimeValue".into(), components: 1, values: Values::F64(vec![time]) };
    for a in std::iter::once(&now).chain(&lines.field_data) {
        let tuples = match &a.values {
            Values::F64(v) => v.len(),
            Values::F32(v) => v.len(),
            Values::I64(v) => v.len(),
            Values::Text(_) => 1,
        };
        array(&mut x, &mut data, a, Some(tuples));
    }
    let _ = writeln!(
        x,
        "</FieldData>\n<Piece NumberOfPoints=\"{}\" NumberOfVerts=\"0\" NumberOfLines=\"{}\" NumberOfStrips=\"0\" NumberOfPolys=\"0\">",
        lines.points.len(),
        lines.lengths.len()
    );
    x += "<PointData>\n";
    lines.point_data.iter().for_each(|a| array(&mut x, &mut data, a, None));
    x += "</PointData>\n<CellData>\n";
    lines.line_data.iter().for_each(|a| array(&mut x, &mut data, a, None));
    x += "</CellData>\n<Points>\n";
    let points = Values::F64(lines.points.iter().flat_map(|p| p.to_array()).collect());
    array(&mut x, &mut data, &DataArray { name: "Points".into(), components: 3, values: points }, None);
    x += "</Points>\n<Lines>\n";
    let connectivity = DataArray::integers("connectivity", 0..lines.points.len() as i64);
    let mut end = 0;
    let offsets = DataArray::integers(
        "offsets",
        lines.lengths.iter().map(|n| {
            end += *n as i64;
            end
        }),
    );
    array(&mut x, &mut data, &connectivity, None);
    array(&mut x, &mut data, &offsets, None);
    x += "</Lines>\n</Piece>\n</PolyData>\n<AppendedData encoding=\"raw\">\n_";
    let mut bytes = x.into_bytes();
    bytes.extend_from_slice(&data.0);
    bytes.extend_from_slice(b"\n</AppendedData>\n</VTKFile>\n");
    bytes
}

/// Writes a `.vtp` file.
///
/// # Errors
/// What the operating system says.
pub fn write(path: &Path, lines: &Polylines, time: f64) -> Result<(), OutputError> {
    write_atomic(path, &encode(lines, time))
}

/// Rewrites the time series: `frames` are (time, path relative to the series file).
///
/// # Errors
/// What the operating system says.
pub fn write_series(path: &Path, frames: &[(f64, String)], provenance: &[(String, String)]) -> Result<(), OutputError> {
    let mut x = format!("<?xml version=\"1.0\"?>\n{}", xml_comment(provenance));
    x.push_str("<VTKFile type=\"Collection\" version=\"1.0\" byte_order=\"LittleEndian\">\n<Collection>\n");
    for (time, file) in frames {
        let _ = writeln!(x, "<DataSet timestep=\"{time:e}\" part=\"0\" file=\"{}\"/>", escape(file));
    }
    x += "</Collection>\n</VTKFile>\n";
    write_atomic(path, x.as_bytes())
}

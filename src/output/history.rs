//! `history.csv`: one row per sample, written as the run goes on.
//!
//! Lines that start with `#` hold the provenance; the header names every column with its unit,
//! `kinetic [mJ]`. Numbers have all their digits (they read back as the same bits). Every row is
//! flushed, so that the file can be watched and survives a crash.
use super::disk::{self, DiskFile};
use super::file::OutputError;
use super::provenance;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// A column of the history.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Column {
    /// Name.
    pub name: String,
    /// Unit, `-` without one.
    pub unit: String,
}

impl Column {
    /// A column.
    pub fn new(name: impl Into<String>, unit: impl Into<String>) -> Self {
        Column { name: name.into(), unit: unit.into() }
    }
    /// Name and unit, as in the header of the file and on plots.
    pub fn header(&self) -> String {
        format!("{} [{}]", self.name, self.unit)
    }
}

/// Rows kept in memory for plots; beyond that every other one is dropped.
const KEPT: usize = 4096;

/// Where a history ends, and what is kept of it for plots.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct HistoryState {
    bytes: u64,
    kept: Vec<Vec<f64>>,
    stride: u64,
    rows: u64,
}

/// The open file and what plots need of it.
pub struct History {
    path: PathBuf,
    writer: csv::Writer<DiskFile>,
    columns: Vec<Column>,
    kept: Vec<Vec<f64>>,
    stride: u64,
    rows: u64,
    /// Length of the file where this run goes on.
    bytes: u64,
}

impl History {
    /// Creates the file with its provenance and header.
    ///
    /// # Errors
    /// What the operating system says.
    pub fn create(path: &Path, provenance: &[(String, String)], columns: Vec<Column>) -> Result<Self, OutputError> {
        use std::io::Write;
        let fail = |e: std::io::Error| OutputError::io("write", path, e);
        let mut file = disk::create(path).map_err(fail)?;
        file.write_all(provenance::lines(provenance, "#").as_bytes()).map_err(fail)?;
        let writer = csv::Writer::from_writer(file);
        let mut history = History { path: path.to_owned(), writer, columns, kept: Vec::new(), stride: 1, rows: 0, bytes: 0 };
        let header: Vec<String> = history.columns.iter().map(Column::header).collect();
        history.record(&header)?;
        Ok(history)
    }

    /// The state now.
    ///
    /// # Errors
    /// What the operating system says.
    pub fn state(&self) -> Result<HistoryState, OutputError> {
        let bytes = self.writer.get_ref().metadata().map_err(|e| OutputError::io("write", &self.path, e))?.len();
        Ok(HistoryState { bytes, kept: self.kept.clone(), stride: self.stride, rows: self.rows })
    }

    /// Waits until all rows are on the disk.
    ///
    /// # Errors
    /// What the operating system says.
    pub fn sync(&self) -> Result<(), OutputError> {
        self.writer.get_ref().sync_data().map_err(|e| OutputError::io("write", &self.path, e))
    }

    /// Opens the file of a run that goes on from a state; [`History::rewind`] then cuts it back.
    ///
    /// # Errors
    /// A file that is shorter than it was; what the operating system says.
    pub fn reopen(path: &Path, columns: Vec<Column>, state: HistoryState) -> Result<Self, OutputError> {
        let fail = |e: std::io::Error| OutputError::io("go on with", path, e);
        let file = disk::append(path).map_err(fail)?;
        let bytes = file.metadata().map_err(fail)?.len();
        if bytes < state.bytes {
            let text = format!("it has {bytes} bytes, and {} at the checkpoint; its end is lost", state.bytes);
            return Err(fail(std::io::Error::other(text)));
        }
        let writer = csv::Writer::from_writer(file);
        let HistoryState { bytes, kept, stride, rows } = state;
        Ok(History { path: path.to_owned(), writer, columns, kept, stride, rows, bytes })
    }

    /// Cuts the file back to the state it was reopened with.
    ///
    /// # Errors
    /// What the operating system says.
    pub fn rewind(&mut self) -> Result<(), OutputError> {
        self.writer.get_ref().set_len(self.bytes).map_err(|e| OutputError::io("cut back", &self.path, e))
    }

    fn record(&mut self, fields: &[String]) -> Result<(), OutputError> {
        let fail = |e: std::io::Error| OutputError::io("write", &self.path, e);
        self.writer.write_record(fields).map_err(|e| fail(e.into()))?;
        self.writer.flush().map_err(fail)
    }

    /// Appends a row; `values` in the order of the columns.
    ///
    /// # Errors
    /// What the operating system says.
    pub fn row(&mut self, values: &[f64]) -> Result<(), OutputError> {
        let fields: Vec<String> = values.iter().map(|v| number(*v)).collect();
        self.record(&fields)?;
        if self.rows.is_multiple_of(self.stride) {
            self.kept.push(values.to_vec());
            if self.kept.len() == KEPT {
                let mut even = false;
                self.kept.retain(|_| {
                    even = !even;
                    even
                });
                self.stride *= 2;
            }
        }
        self.rows += 1;
        Ok(())
    }

    /// The columns.
    pub fn columns(&self) -> &[Column] {
        &self.columns
    }

    /// Points (column `x`, column `y`) for a plot; none if a name is unknown.
    pub fn points(&self, x: &str, y: &str) -> Vec<(f64, f64)> {
        let place = |name: &str| self.columns.iter().position(|c| c.name == name);
        match (place(x), place(y)) {
            (Some(x), Some(y)) => self.kept.iter().map(|r| (r[x], r[y])).collect(),
            _ => Vec::new(),
        }
    }

    /// Rows written so far.
    pub fn rows(&self) -> u64 {
        self.rows
    }
}

/// The shortest text that reads back as the same number; whole numbers without a fraction.
pub fn number(v: f64) -> String {
    if v == v.trunc() && v.abs() < 1e15 { format!("{}", v + 0.0) } else { format!("{v:?}") }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_file_reads_back_with_all_digits() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("history.csv");
        let columns = vec![Column::new("time", "s"), Column::new("probe, \"odd\"", "mm"), Column::new("ratio", "-")];
        let provenance = [("scene".to_owned(), "a\nb".to_owned())];
        let mut h = History::create(&path, &provenance, columns).unwrap();
        let rows = [[0.0, 1.0 / 3.0, f64::NAN], [1e-7, -2.5e-300, 3.0], [0.1 + 0.2, 1e22, f64::INFINITY]];
        for (i, r) in rows.iter().enumerate() {
            h.row(r).unwrap();
            // Every row is in the file at once.
            assert_eq!(std::fs::read_to_string(&path).unwrap().lines().count(), 3 + i);
        }
        let text = std::fs::read_to_string(&path).unwrap();
        assert!(text.starts_with("# scene: a b\n"), "{text}");
        let mut reader = csv::ReaderBuilder::new().comment(Some(b'#')).from_path(&path).unwrap();
        assert_eq!(reader.headers().unwrap().iter().collect::<Vec<_>>(), ["time [s]", "probe, \"odd\" [mm]", "ratio [-]"]);
        for (record, row) in reader.records().zip(rows) {
            for (field, value) in record.unwrap().iter().zip(row) {
                let read: f64 = field.parse().unwrap();
                assert!(read.to_bits() == value.to_bits() || (read.is_nan() && value.is_nan()), "{field} {value}");
            }
        }
        assert_eq!(h.points("time", "ratio")[1], (1e-7, 3.0));
        assert!(h.points("time", "nothing").is_empty());
    }

    #[test]
    fn long_histories_are_thinned_in_memory_only() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("history.csv");
        let mut h = History::create(&path, &[], vec![Column::new("time", "s")]).unwrap();
        for i in 0..10_000 {
            h.row(&[f64::from(i)]).unwrap();
        }
        assert_eq!(std::fs::read_to_string(&path).unwrap().lines().count(), 10_001);
        let points = h.points("time", "time");
        assert!(points.len() < KEPT && points.len() > KEPT / 4);
        // Still evenly spaced from the first row on.
        let step = points[1].0 - points[0].0;
        assert!(points.windows(2).all(|w| w[1].0 - w[0].0 == step));
    }
}

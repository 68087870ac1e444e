//! CSV tables of numbers, with the line number of whatever is wrong. Lines count from 1.

use std::path::Path as FilePath;

use crate::error::{Error, Result};

/// A header and rows of finite numbers.
pub(super) struct Table {
    pub header: Vec<String>,
    /// Line of the header in the file.
    pub header_line: u64,
    /// Line in the file and its numbers, one per column.
    pub rows: Vec<(u64, Vec<f64>)>,
    /// One word per row, where the file has the column of words that was asked for; it is in neither header nor rows.
    pub words: Option<Vec<String>>,
    file: String,
}

impl Table {
    /// Reads a whole file.
    pub fn read(file: &FilePath) -> Result<Self> {
        Self::read_file(file, None)
    }

    /// Reads a whole file in which one column may hold words.
    pub fn read_with_words(file: &FilePath, column: &str) -> Result<Self> {
        Self::read_file(file, Some(column))
    }

    fn read_file(file: &FilePath, words: Option<&str>) -> Result<Self> {
        let name = file.display().to_string();
        let broken = |message: String| Error::File { file: name.clone(), message };
        let bytes = std::fs::read(file).map_err(|error| broken(format!("cannot be read: {error}")))?;
        Self::parse(&name, &bytes, words)
    }

    fn parse(name: &str, bytes: &[u8], words: Option<&str>) -> Result<Self> {
        let text = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes);
        let at = |line: u64, message: String| Error::File { file: format!("{name}:{line}"), message };
        let mut reader = csv::ReaderBuilder::new()
            .has_headers(false)
            .flexible(true)
            .trim(csv::Trim::All)
            .from_reader(text);
        let mut table =
            Self { header: Vec::new(), header_line: 1, rows: Vec::new(), words: None, file: name.into() };
        for record in reader.byte_records() {
            let record = record.map_err(|error| {
                let line = error.position().map_or(1, |position| line_of(text, position));
                at(line, format!("is not CSV: {error}"))
            })?;
            let line = record.position().map_or(1, |position| line_of(text, position));
            let fields = record
                .iter()
                .map(|field| std::str::from_utf8(field).map_err(|_| at(line, "is not UTF-8 text".into())))
                .collect::<Result<Vec<&str>>>()?;
            if fields.iter().all(|field| field.is_empty()) {
                continue;
            }
            if table.header.is_empty() {
                if fields.iter().all(|field| field.parse::<f64>().is_ok()) {
                    return Err(at(
                        line,
                        "holds numbers, expected a header with the names of the columns".into(),
                    ));
                }
                table.header_line = line;
                table.header = fields.iter().map(|field| (*field).to_owned()).collect();
                continue;
            }
            if fields.len() != table.header.len() {
                let message = format!("has {} columns, the header has {}", fields.len(), table.header.len());
                return Err(at(line, message));
            }
            let mut numbers = Vec::with_capacity(fields.len());
            for (field, column) in fields.iter().zip(&table.header) {
                if words == Some(column) {
                    table.words.get_or_insert_default().push((*field).to_owned());
                    continue;
                }
                let value: f64 = field
                    .parse()
                    .map_err(|_| at(line, format!("column '{column}': '{field}' is not a number")))?;
                if !value.is_finite() {
                    return Err(at(line, format!("column '{column}' is {value}, it must be finite")));
                }
                numbers.push(value);
            }
            table.rows.push((line, numbers));
        }
        if table.header.is_empty() {
            return Err(at(1, "is empty, expected a header line with the names of the columns".into()));
        }
        for (i, name) in table.header.iter().enumerate() {
            if table.header[..i].contains(name) {
                return Err(table.error(table.header_line, format!("column '{name}' occurs twice")));
            }
        }
        table.header.retain(|column| words != Some(column));
        Ok(table)
    }

    /// An error in this file at a line.
    pub fn error(&self, line: u64, message: String) -> Error {
        Error::File { file: format!("{}:{line}", self.file), message }
    }

    /// An error about the whole file.
    pub fn error_in_file(&self, message: String) -> Error {
        Error::File { file: self.file.clone(), message }
    }

    /// Index of a column.
    pub fn column(&self, name: &str) -> Option<usize> {
        self.header.iter().position(|column| column == name)
    }
}

/// Line on which a record starts: the reader's position is that of the blank lines before it.
fn line_of(text: &[u8], position: &csv::Position) -> u64 {
    let start = usize::try_from(position.byte()).unwrap_or(usize::MAX).min(text.len());
    let blank = text[start..].iter().take_while(|byte| matches!(byte, b'\r' | b'\n'));
    position.line() + blank.filter(|byte| **byte == b'\n').count() as u64
}

/// Writes a header and rows of numbers; the shortest text that reads back as the same number.
pub(super) fn write(file: &FilePath, header: &[String], rows: impl Iterator<Item = Vec<f64>>) -> Result<()> {
    write_records(file, header, rows.map(|row| row.iter().map(f64::to_string).collect()))
}

/// Writes a header and rows of fields.
pub(super) fn write_records(
    file: &FilePath,
    header: &[String],
    rows: impl Iterator<Item = Vec<String>>,
) -> Result<()> {
    let run = || -> csv::Result<()> {
        let mut writer = csv::Writer::from_path(file)?;
        writer.write_record(header)?;
        for row in rows {
            writer.write_record(row)?;
        }
        writer.flush()?;
        Ok(())
    };
    run().map_err(|error| Error::File {
        file: file.display().to_string(),
        message: format!("cannot be written: {error}"),
    })
}

//! Points of the chart: cost and error of one method on one scene; written as JSON and CSV.
//!
//! The field names are a contract with the readers of `points.json`: names are never changed, new fields may be added.
//! Numbers that are not finite (PSNR of equal pictures) are null in JSON and empty in CSV.

use serde::{Deserialize, Serialize};

/// One method with its parameters, on one scene with one transfer function.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Point {
    /// Name of the scene.
    pub scene: String,
    /// Name of the transfer function: `smooth`, `spike shaded`, ...
    pub transfer_function: String,
    /// Family of the method.
    pub method: String,
    /// Parameters that identify the method within its family.
    pub parameters: String,
    /// Backend: `cpu`, or the name of the graphics adapter.
    pub backend: String,
    /// Processor time of one warm picture, ms: median.
    pub cpu_ms: f64,
    /// Spread of the processor time: greatest minus least, ms.
    pub cpu_ms_spread: f64,
    /// Wall time of one warm picture, ms: median.
    pub wall_ms: f64,
    /// Number of timed warm pictures.
    pub repeats: usize,
    /// Processor time of the first picture, ms: opening, reading and decoding of bricks, tables, rays.
    pub cold_cpu_ms: f64,
    /// Classified values in one picture.
    pub samples: u64,
    /// Trilinear cells crossed in one picture; 0 for methods that do not work cell by cell.
    pub cells: u64,
    /// Bytes of bricks read by the first picture.
    pub bytes_read: u64,
    /// Bricks read by the first picture.
    pub bricks_read: u64,
    /// Peak bytes of bricks in host memory.
    pub brick_memory_bytes: u64,
    /// Peak resident memory of the process since its start, bytes; includes all earlier points.
    pub peak_rss_bytes: u64,
    /// Greatest difference of any channel of any pixel, fraction of full scale.
    pub linf: f64,
    /// 99.9th percentile of the differences, fraction of full scale.
    pub p999: f64,
    /// Root mean square difference, fraction of full scale.
    pub rmse: f64,
    /// `-20 log10(rmse)`; null for equal pictures.
    pub psnr_db: Option<f64>,
    /// Mean signed difference, picture minus exact picture, fraction of full scale.
    pub bias: f64,
    /// FLIP, mean over all pixels: 0 (equal) to 1; `None` without the feature `flip`.
    pub flip: Option<f64>,
    /// Whether the point is on the Pareto front of its scene and look: no CPU method is both cheaper and more accurate.
    pub pareto: bool,
    /// Whether these are the default settings.
    pub default: bool,
    /// Requested error, fraction of full scale; null for methods without error control.
    pub max_error: Option<f64>,
    /// Stated error: the greatest of any pixel, fraction of full scale; null for methods that state none.
    pub stated: Option<f64>,
}

/// The columns of `points.csv`, in order: the keys of `points.json`.
pub const COLUMNS: [&str; 26] = [
    "scene",
    "transfer_function",
    "method",
    "parameters",
    "backend",
    "cpu_ms",
    "cpu_ms_spread",
    "wall_ms",
    "repeats",
    "cold_cpu_ms",
    "samples",
    "cells",
    "bytes_read",
    "bricks_read",
    "brick_memory_bytes",
    "peak_rss_bytes",
    "linf",
    "p999",
    "rmse",
    "psnr_db",
    "bias",
    "flip",
    "pareto",
    "default",
    "max_error",
    "stated",
];

/// Backend of the points with comparable processor times.
pub const CPU: &str = "cpu";

/// Marks the Pareto front of (`cpu_ms`, `linf`) among the CPU points of one scene and transfer function.
///
/// Points that are equal in both count once: the first is marked. Never marked are
/// - points of a GPU, which have no comparable processor time;
/// - repetitions of the default (same picture and work, say from another codec): their warm cost differs only by noise.
pub fn mark_front(points: &mut [Point]) {
    let default = points.iter().find(|p| p.default).cloned();
    let competes = |p: &Point| p.backend == CPU && !default.as_ref().is_some_and(|d| repeats(p, d));
    let mut order: Vec<usize> = (0..points.len()).filter(|&i| competes(&points[i])).collect();
    order.sort_by(|&a, &b| {
        let key = |i: usize| (points[i].cpu_ms, points[i].linf);
        key(a).0.total_cmp(&key(b).0).then(key(a).1.total_cmp(&key(b).1))
    });
    points.iter_mut().for_each(|p| p.pareto = false);
    let mut nearest = f64::INFINITY;
    for i in order {
        if points[i].linf < nearest {
            nearest = points[i].linf;
            points[i].pareto = true;
        }
    }
}

/// Whether a point other than the default's has the same work and the same picture as the default.
fn repeats(point: &Point, default: &Point) -> bool {
    let work = |p: &Point| (p.samples, p.cells);
    let errors = |p: &Point| [p.linf, p.p999, p.rmse, p.bias];
    !point.default && work(point) == work(default) && errors(point) == errors(default)
}

/// The points as a JSON array, one object a point.
///
/// # Panics
/// Never: all fields are numbers, texts or truth values.
#[must_use]
pub fn to_json(points: &[Point]) -> String {
    serde_json::to_string_pretty(points).expect("points hold nothing that JSON cannot") + "\n"
}

/// The points as CSV (RFC 4180); the first line is [`COLUMNS`].
///
/// # Panics
/// Never: see [`to_json`].
#[must_use]
pub fn to_csv(points: &[Point]) -> String {
    let mut text = COLUMNS.join(",") + "\r\n";
    for point in points {
        let object = serde_json::to_value(point).expect("points hold nothing that JSON cannot");
        let cells = COLUMNS.map(|column| match &object[column] {
            serde_json::Value::Null => String::new(),
            serde_json::Value::String(s) => quoted(s),
            other => other.to_string(),
        });
        text += &cells.join(",");
        text += "\r\n";
    }
    text
}

/// A CSV field: quoted if it contains a separator, a quotation mark or a line break.
fn quoted(field: &str) -> String {
    if field.contains([',', '"', '\n', '\r']) { format!("\"{}\"", field.replace('"', "\"\"")) } else { field.into() }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    pub(crate) fn point(method: &str, cpu_ms: f64, linf: f64) -> Point {
        Point {
            scene: "thin".into(),
            transfer_function: "spike".into(),
            method: method.into(),
            parameters: "step 1, \"fine\"".into(),
            max_error: None,
            stated: None,
            backend: CPU.into(),
            cpu_ms,
            cpu_ms_spread: 0.1,
            wall_ms: cpu_ms / 2.0,
            repeats: 3,
            cold_cpu_ms: cpu_ms * 2.0,
            samples: 10,
            cells: 0,
            bytes_read: 5,
            bricks_read: 1,
            brick_memory_bytes: 7,
            peak_rss_bytes: 9,
            linf,
            p999: linf,
            rmse: linf / 3.0,
            psnr_db: (linf > 0.0).then_some(40.0),
            bias: 0.0,
            flip: Some(0.0),
            pareto: false,
            default: method == "default",
        }
    }

    #[test]
    fn the_front_holds_what_nothing_beats_in_both() {
        let values = [(4.0, 0.1), (1.0, 0.5), (2.0, 0.5), (3.0, 0.2), (3.0, 0.3), (9.0, 0.1), (10.0, 0.0), (1.0, 0.6)];
        let mut points: Vec<Point> = values.iter().map(|&(cost, error)| point("m", cost, error)).collect();
        let mut gpu = point("gpu", 0.1, 0.0);
        gpu.backend = "llvmpipe".into();
        points.push(gpu);
        mark_front(&mut points);
        let marked: Vec<usize> = (0..points.len()).filter(|&i| points[i].pareto).collect();
        assert_eq!(marked, [0, 1, 3, 6]);

        let mut again = vec![point("default", 2.0, 0.1), point("codec", 1.9, 0.1), point("faster", 1.0, 0.1)];
        again[2].samples = 9;
        mark_front(&mut again[..2]);
        assert!(again[0].pareto && !again[1].pareto, "a repetition of the default does not beat it");
        mark_front(&mut again);
        assert!(!again[0].pareto && again[2].pareto);
    }

    #[test]
    fn json_has_the_promised_keys_and_null_for_infinity() {
        let exact = serde_json::from_str::<serde_json::Value>(&to_json(&[point("default", 1.0, 0.0)])).unwrap();
        let object = exact[0].as_object().unwrap();
        let mut keys: Vec<&str> = object.keys().map(String::as_str).collect();
        let mut columns = COLUMNS.to_vec();
        keys.sort_unstable();
        columns.sort_unstable();
        assert_eq!(keys, columns);
        assert!(object["psnr_db"].is_null() && object["default"] == true);
    }

    #[test]
    fn csv_quotes_what_needs_it_and_has_a_cell_for_each_column() {
        let text = to_csv(&[point("plain", 1.5, 0.0)]);
        let lines: Vec<&str> = text.split("\r\n").collect();
        assert_eq!(lines[0].split(',').count(), COLUMNS.len());
        assert!(lines[1].starts_with("thin,spike,plain,\"step 1, \"\"fine\"\"\",cpu,1.5,"), "{}", lines[1]);
        assert!(lines[1].contains(",0.0,,0.0,"), "an infinite PSNR is an empty cell: {}", lines[1]);
        assert_eq!(lines.len(), 3);
    }
}

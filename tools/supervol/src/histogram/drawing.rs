//! Histogram as an SVG drawing: one bar for each bin in the colour of the default picture, and the opacity as a line.

use plotters::coord::combinators::IntoLogRange;
use plotters::coord::ranged1d::{AsRangedCoord, Ranged, ValueFormatter};
use plotters::prelude::*;
use supervol_format::cast::whole;
use supervol_format::readable::Number;
use supervol_scene::facts::VolumeFacts;
use supervol_scene::transfer_function::TransferFunction;

/// Width and height, SVG units.
const SIZE: (u32, u32) = (720, 400);
/// Outline of the bars.
const GREY: RGBColor = RGBColor(120, 124, 128);
/// Percentiles that are marked.
const MARKED: [f64; 3] = [1.0, 50.0, 99.0];

/// Content of the drawing.
pub struct Drawing<'a> {
    /// Name of the volume.
    pub name: &'a str,
    /// Unit of its values; may be empty.
    pub unit: &'a str,
    /// Counts, range, percentiles.
    pub facts: &'a VolumeFacts,
    /// Colours and opacities of the default picture.
    pub shown: &'a TransferFunction,
    /// Whether bars are proportional to counts instead of their logarithms.
    pub linear: bool,
}

impl Drawing<'_> {
    /// Draws the SVG text.
    pub fn svg(&self) -> Result<String, String> {
        let most = self.facts.histogram.iter().copied().max().unwrap_or(0).max(2) as f64;
        let mut svg = String::new();
        if self.linear {
            self.draw(&mut svg, 0.0..1.05 * most, 0.0)?;
        } else {
            self.draw(&mut svg, (0.8..1.5 * most).log_scale(), 0.8)?;
        }
        Ok(svg)
    }

    /// Bars begin at `floor`.
    fn draw<Y>(&self, svg: &mut String, counts: Y, floor: f64) -> Result<(), String>
    where
        Y: AsRangedCoord<Value = f64>,
        Y::CoordDescType: Ranged<ValueType = f64> + ValueFormatter<f64>,
    {
        let failed = |e: DrawingAreaErrorKind<std::io::Error>| e.to_string();
        let range = self.facts.central_range;
        let area = SVGBackend::with_string(svg, SIZE).into_drawing_area();
        area.fill(&WHITE).map_err(failed)?;
        let mut builder = ChartBuilder::on(&area);
        builder.margin(10).x_label_area_size(46).y_label_area_size(64).right_y_label_area_size(52);
        builder.caption(self.name, ("sans-serif", 16));
        let chart = builder.build_cartesian_2d(range.min..range.max, counts).map_err(failed)?;
        let mut chart = chart.set_secondary_coord(range.min..range.max, 0.0..1.0);
        let unit = if self.unit.is_empty() { String::new() } else { format!(" ({})", self.unit) };
        let mut mesh = chart.configure_mesh();
        mesh.disable_x_mesh().light_line_style(TRANSPARENT).x_desc(format!("value{unit}")).y_desc("voxels");
        mesh.x_label_formatter(&|v| Number(*v).to_string())
            .y_label_formatter(&|n| format!("{n:.0}"))
            .label_style(("sans-serif", 12));
        mesh.draw().map_err(failed)?;
        let mut opacities = chart.configure_secondary_axes();
        opacities.y_desc("opacity").label_style(("sans-serif", 12)).draw().map_err(failed)?;

        let bins = self.facts.histogram.len();
        let edge = |bin: usize| {
            let share = bin as f64 / bins as f64;
            range.min * (1.0 - share) + range.max * share
        };
        let counted = self.facts.histogram.iter().enumerate().filter(|(_, count)| **count > 0);
        let bars = counted.map(|(bin, &count)| {
            let corners = [(edge(bin), floor), (edge(bin + 1), count as f64)];
            Rectangle::new(corners, self.color(0.5 * edge(bin) + 0.5 * edge(bin + 1)).filled())
        });
        chart.draw_series(bars).map_err(failed)?;
        // White bars also need an outline.
        let height = |bin: usize| (self.facts.histogram[bin] as f64).max(floor);
        let outline = (0..bins).flat_map(|bin| [edge(bin), edge(bin + 1)].map(|value| (value, height(bin))));
        chart.draw_series(LineSeries::new(outline, GREY)).map_err(failed)?;
        let marked = self.facts.percentiles.iter().filter(|(percent, _)| MARKED.contains(percent));
        let marks = marked.map(|&(_, at)| PathElement::new([(at, 0.0), (at, 0.04)], BLACK.stroke_width(2)));
        chart.draw_secondary_series(marks).map_err(failed)?;
        let opacity = (0..=4 * bins).map(|i| {
            let share = i as f64 / (4 * bins) as f64;
            let value = range.min * (1.0 - share) + range.max * share;
            (value, self.shown.classify(value).1)
        });
        chart.draw_secondary_series(LineSeries::new(opacity, BLACK.stroke_width(2))).map_err(failed)?;
        area.present().map_err(failed)
    }

    /// Colour of a value; grey where the opacity is zero.
    fn color(&self, value: f64) -> RGBColor {
        let (color, opacity) = self.shown.classify(value);
        if opacity <= 0.0 {
            return RGBColor(200, 204, 208);
        }
        let [r, g, b] = color.map(|c| whole::<u8>((c * 255.0).round()));
        RGBColor(r, g, b)
    }
}

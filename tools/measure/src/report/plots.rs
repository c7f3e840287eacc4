//! Plots as inline SVG.
//!
//! A [`Plot`] is data: lines and single points on two axes, each linear or logarithmic. A logarithmic axis draws values
//! at or below 0, and values below its range, at its lower end.

use plotters::coord::ranged1d::{KeyPointHint, NoDefaultFormatting, Ranged, ValueFormatter};
use plotters::coord::types::RangedCoordf64;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};
use supervol_format::cast::whole;

use super::compact::compact;
use super::palette::{self, BLACK as INK, BLUE, GREY, Look, Mark, VERMILLION};

/// Width and height of a plot, SVG units.
const SIZE: (u32, u32) = (560, 400);
/// Range of an axis without data.
const EMPTY: [f64; 2] = [0.1, 10.0];
/// Ratio of greatest to least value from which an automatic axis is logarithmic.
const LOGARITHMIC_RATIO: f64 = 30.0;
/// Largest number of decades of a logarithmic axis: smaller values are drawn at its lower end.
const MOST_DECADES: f64 = 9.0;

/// Scaling of an axis.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Scaling {
    /// Logarithmic if all values are positive and span more than 1.5 decades, otherwise linear.
    Automatic,
    /// Always logarithmic.
    Logarithmic,
}

/// A line or points.
#[derive(Debug, Clone)]
pub struct Series {
    /// Name for the legend; empty: no legend entry.
    pub name: String,
    /// Colour and mark.
    pub look: Look,
    /// Points, in the order of the connecting line.
    pub points: Vec<(f64, f64)>,
}

/// A plot.
#[derive(Debug, Clone)]
pub struct Plot {
    /// Label of the horizontal axis, with unit.
    pub x_label: String,
    /// Label of the vertical axis, with unit.
    pub y_label: String,
    /// Scaling of the horizontal and the vertical axis.
    pub scaling: [Scaling; 2],
    /// Lines with marks.
    pub series: Vec<Series>,
    /// Thin grey lines without marks: expected values.
    pub guides: Vec<Vec<(f64, f64)>>,
    /// Staircase line of the Pareto front.
    pub front: Vec<(f64, f64)>,
    /// A horizontal limit and its name.
    pub limit: Option<(f64, String)>,
    /// A point with a ring and a name.
    pub ringed: Option<(f64, f64, String)>,
    /// Points with a small name.
    pub named: Vec<Named>,
    /// Whether the plot has its own legend.
    pub has_legend: bool,
}

/// A point with a name.
#[derive(Debug, Clone, PartialEq)]
pub struct Named {
    /// Position in data coordinates.
    pub at: (f64, f64),
    /// Plain text.
    pub name: String,
    /// Position of the name relative to the point.
    pub side: Side,
}

/// Position of a name relative to its point.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Side {
    /// To the left of the point.
    Left,
    /// To the right of the point, below it.
    Right,
}

/// An axis: range and scaling. In the drawing, a logarithmic axis is a linear axis of decimal logarithms.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Axis {
    range: [f64; 2],
    is_logarithmic: bool,
}

impl Axis {
    /// An axis for these values; values that are not finite are left out.
    fn of(values: impl Iterator<Item = f64>, scaling: Scaling) -> Self {
        let values: Vec<f64> = values.filter(|v| v.is_finite()).collect();
        let positive: Vec<f64> = values.iter().copied().filter(|v| *v > 0.0).collect();
        let [least, greatest] = extremes(&positive).unwrap_or(EMPTY);
        let is_wide = !positive.is_empty() && values.iter().all(|v| *v >= 0.0) && greatest / least > LOGARITHMIC_RATIO;
        if scaling == Scaling::Logarithmic || is_wide {
            let least = least.max(greatest * 10f64.powf(-MOST_DECADES));
            return Self { range: [least / 1.7, greatest * 1.7], is_logarithmic: true };
        }
        let [least, greatest] = extremes(&values).unwrap_or(EMPTY);
        let margin = if greatest > least { 0.06 * (greatest - least) } else { 0.1 * greatest.abs().max(1.0) };
        let reaches_zero = least == 0.0 || (least > 0.0 && least <= 2.0 * (greatest - least));
        let low = if reaches_zero { 0.0 } else { least - margin };
        Self { range: [low, greatest + margin], is_logarithmic: false }
    }

    /// Position in the drawing. Values beyond an end of the axis are moved to that end.
    fn place(&self, value: f64) -> f64 {
        self.on_paper(value.clamp(self.range[0], self.range[1]))
    }

    fn on_paper(&self, value: f64) -> f64 {
        if self.is_logarithmic { value.log10() } else { value }
    }

    /// Values with a tick. Logarithmic axes: powers of ten, short axes also 2 and 5 times these. Linear axes: round
    /// steps.
    fn ticks(&self) -> Vec<f64> {
        let [low, high] = self.range;
        if self.is_logarithmic {
            let decades = (high / low).log10();
            let mantissas: &[f64] = if decades <= 2.5 { &[1.0, 2.0, 5.0] } else { &[1.0] };
            let every = if decades > 7.0 { 2 } else { 1 };
            let exponents =
                (whole::<i32>(low.log10().floor())..=whole::<i32>(high.log10().ceil())).filter(|e| e % every == 0);
            let values = exponents.flat_map(|e| mantissas.iter().map(move |m| m * 10f64.powi(e)));
            return values.filter(|v| (low..=high).contains(v)).collect();
        }
        let rough = (high - low) / 6.0;
        let power = 10f64.powf(rough.log10().floor());
        let step = [1.0, 2.0, 5.0, 10.0].map(|m| m * power).into_iter().find(|s| *s >= rough).unwrap_or(rough);
        let first = (low / step).ceil();
        (0..20).map(|i| (first + f64::from(i)) * step).take_while(|v| *v <= high).collect()
    }
}

/// The axis for the plotting library: values are positions in the drawing, ticks are [`Axis::ticks`].
impl Ranged for Axis {
    type FormatOption = NoDefaultFormatting;
    type ValueType = f64;

    fn map(&self, value: &f64, pixels: (i32, i32)) -> i32 {
        RangedCoordf64::from(self.range()).map(value, pixels)
    }

    fn key_points<Hint: KeyPointHint>(&self, _: Hint) -> Vec<f64> {
        self.ticks().into_iter().map(|v| self.on_paper(v)).collect()
    }

    fn range(&self) -> std::ops::Range<f64> {
        let [low, high] = self.range.map(|v| self.on_paper(v));
        low..high
    }
}

impl ValueFormatter<f64> for Axis {
    fn format(on_paper: &f64) -> String {
        tick(*on_paper)
    }

    fn format_ext(&self, on_paper: &f64) -> String {
        tick(if self.is_logarithmic { 10f64.powf(*on_paper) } else { *on_paper })
    }
}

fn extremes(values: &[f64]) -> Option<[f64; 2]> {
    let least = values.iter().copied().min_by(f64::total_cmp)?;
    let greatest = values.iter().copied().max_by(f64::total_cmp)?;
    Some([least, greatest])
}

impl Plot {
    /// A plot of only these lines on logarithmic axes, with a legend.
    #[must_use]
    pub fn of_lines([x_label, y_label]: [&str; 2], series: Vec<Series>) -> Self {
        Self {
            x_label: x_label.into(),
            y_label: y_label.into(),
            scaling: [Scaling::Logarithmic; 2],
            series,
            guides: Vec::new(),
            front: Vec::new(),
            limit: None,
            ringed: None,
            named: Vec::new(),
            has_legend: true,
        }
    }

    /// The plot with the label of its vertical axis above it, where long labels fit, and its legend below it.
    #[must_use]
    pub fn html(&self) -> String {
        let named = self.series.iter().filter(|s| self.has_legend && !s.name.is_empty());
        let items: Vec<(&str, Look)> = named.map(|s| (s.name.as_str(), s.look)).collect();
        let label = format!("<div class=\"axis\">↑ {}</div>", super::html::escape(&self.y_label));
        label + &self.svg() + &palette::legend(&items)
    }

    /// The plot as an SVG element.
    #[must_use]
    pub fn svg(&self) -> String {
        let points = || self.series.iter().flat_map(|s| &s.points).chain(&self.front);
        let limit = self.limit.iter().map(|(y, _)| *y);
        let x = Axis::of(points().map(|p| p.0), self.scaling[0]);
        let y = Axis::of(points().map(|p| p.1).chain(limit), self.scaling[1]);
        let mut svg = String::new();
        match self.draw(&mut svg, [x, y]) {
            Ok(()) => scalable(&svg),
            Err(error) => format!("<p>This plot could not be drawn: {}</p>", super::html::escape(&error)),
        }
    }

    fn draw(&self, svg: &mut String, axes: [Axis; 2]) -> Result<(), String> {
        let failed = |e: DrawingError| e.to_string();
        let area = SVGBackend::with_string(svg, SIZE).into_drawing_area();
        let mut builder = ChartBuilder::on(&area);
        builder.margin(8).margin_right(18).x_label_area_size(46).y_label_area_size(52);
        let mut chart = builder.build_cartesian_2d(axes[0], axes[1]).map_err(failed)?;
        chart
            .configure_mesh()
            .x_labels(8)
            .y_labels(10)
            .light_line_style(TRANSPARENT)
            .bold_line_style(RGBColor(226, 230, 234))
            .axis_style(GREY)
            .label_style(("sans-serif", 13))
            .axis_desc_style(("sans-serif", 14))
            .x_desc(&self.x_label)
            .draw()
            .map_err(failed)?;
        let at = |&(a, b): &(f64, f64)| (axes[0].place(a), axes[1].place(b));
        let line = |points: &[(f64, f64)]| points.iter().filter(|p| is_point(p)).map(at).collect::<Vec<_>>();

        for guide in &self.guides {
            chart.draw_series(DashedLineSeries::new(line(guide), 5, 4, GREY.stroke_width(1))).map_err(failed)?;
        }
        if let Some((limit, name)) = &self.limit {
            let ends = axes[0].range.map(|x| (x, *limit));
            chart
                .draw_series(DashedLineSeries::new(ends.map(|p| at(&p)), 7, 4, VERMILLION.stroke_width(1)))
                .map_err(failed)?;
            // Label at the right: fast and accurate methods are at the left.
            let anchor = Pos::new(HPos::Right, VPos::Bottom);
            let style = ("sans-serif", 12).into_font().color(&VERMILLION).pos(anchor);
            let text = EmptyElement::at(at(&ends[1])) + Text::new(name.clone(), (-4, -4), style);
            chart.draw_series([text]).map_err(failed)?;
        }
        chart
            .draw_series(LineSeries::new(line(&staircase(&self.front, axes[0].range[1])), INK.mix(0.55)))
            .map_err(failed)?;
        for series in &self.series {
            let points = line(&series.points);
            if series.look.joined {
                chart.draw_series(LineSeries::new(points.clone(), series.look.color.mix(0.55))).map_err(failed)?;
            }
            draw_marks(&mut chart, &points, series.look).map_err(failed)?;
        }
        for named in self.named.iter().filter(|named| is_point(&named.at)) {
            let (anchor, offset) = match named.side {
                Side::Left => (HPos::Right, (-8, 0)),
                Side::Right => (HPos::Left, (8, 7)),
            };
            let style = ("sans-serif", 11).into_font().color(&BLUE).pos(Pos::new(anchor, VPos::Center));
            let text = EmptyElement::at(at(&named.at)) + Text::new(named.name.clone(), offset, style);
            chart.draw_series([text]).map_err(failed)?;
        }
        if let Some((a, b, name)) = self.ringed.as_ref().filter(|(a, b, _)| is_point(&(*a, *b))) {
            let style = ("sans-serif", 13).into_font().style(FontStyle::Bold).color(&INK);
            let ring = EmptyElement::at(at(&(*a, *b)))
                + Circle::new((0, 0), 9, INK.stroke_width(2))
                + Text::new(name.clone(), (-22, 11), style);
            chart.draw_series([ring]).map_err(failed)?;
        }
        area.present().map_err(failed)
    }
}

fn is_point(&(x, y): &(f64, f64)) -> bool {
    x.is_finite() && y.is_finite()
}

/// Corners of a front that goes right and then down, extended to the right end of the axis.
fn staircase(front: &[(f64, f64)], right: f64) -> Vec<(f64, f64)> {
    let mut corners = Vec::with_capacity(2 * front.len());
    for (i, &(x, y)) in front.iter().enumerate() {
        corners.push((x, y));
        corners.push((front.get(i + 1).map_or(right, |next| next.0), y));
    }
    corners
}

type Paper<'a, 'b> = ChartContext<'a, SVGBackend<'b>, Cartesian2d<Axis, Axis>>;
type DrawingError = DrawingAreaErrorKind<std::io::Error>;

/// Draws marks at positions in the drawing.
fn draw_marks(chart: &mut Paper<'_, '_>, places: &[(f64, f64)], look: Look) -> Result<(), DrawingError> {
    let style = look.color.filled();
    let places = places.iter().map(|p| EmptyElement::at(*p));
    match look.mark {
        Mark::Circle => chart.draw_series(places.map(|at| at + Circle::new((0, 0), 4, style)))?,
        Mark::Square => chart.draw_series(places.map(|at| at + Rectangle::new([(-4, -4), (4, 4)], style)))?,
        Mark::Triangle => chart.draw_series(places.map(|at| at + TriangleMarker::new((0, 0), 6, style)))?,
        Mark::Diamond => {
            chart.draw_series(places.map(|at| at + Polygon::new(vec![(0, -5), (5, 0), (0, 5), (-5, 0)], style)))?
        }
        Mark::Cross => chart.draw_series(places.map(|at| at + Cross::new((0, 0), 4, look.color.stroke_width(2))))?,
    };
    Ok(())
}

/// Text of a tick.
fn tick(value: f64) -> String {
    let size = value.abs();
    if value == 0.0 || (9.99e-4..1e5).contains(&size) {
        return super::html::number((value * 1e9).round() / 1e9);
    }
    let exponent = (size.log10() + 1e-9).floor();
    let mantissa = value / 10f64.powf(exponent);
    let power = format!("10{}", superscript(whole::<i32>(exponent)));
    if (mantissa - 1.0).abs() < 1e-6 { power } else { format!("{}·{power}", super::html::number(mantissa)) }
}

fn superscript(exponent: i32) -> String {
    const DIGITS: [char; 10] = ['⁰', '¹', '²', '³', '⁴', '⁵', '⁶', '⁷', '⁸', '⁹'];
    let digit = |c: char| c.to_digit(10).map_or('⁻', |d| DIGITS[d as usize]);
    exponent.to_string().chars().map(digit).collect()
}

/// The SVG without its fixed size, so that the page sets it, and without the namespace that only files need; shortened.
fn scalable(svg: &str) -> String {
    let (width, height) = SIZE;
    let sized = format!("<svg width=\"{width}\" height=\"{height}\" ");
    compact(&svg.replacen(&sized, "<svg ", 1).replacen(" xmlns=\"http://www.w3.org/2000/svg\"", "", 1))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn plot(points: &[(f64, f64)]) -> Plot {
        Plot {
            x_label: "cost, ms".into(),
            y_label: "error <share>".into(),
            scaling: [Scaling::Logarithmic, Scaling::Automatic],
            series: vec![Series { name: "a & b".into(), look: palette::look("storage", 0), points: points.to_vec() }],
            guides: vec![points.to_vec()],
            front: points.to_vec(),
            limit: Some((1e-3, "limit".into())),
            ringed: Some((1.0, 0.1, "default".into())),
            named: vec![Named { at: (2.0, 0.0), name: "E <8>".into(), side: Side::Left }],
            has_legend: true,
        }
    }

    #[test]
    fn plots_scale_with_the_page_and_their_text_is_escaped() {
        let plot = plot(&[(1.0, 0.1), (2.0, 0.0), (30.0, 1e-4), (f64::NAN, 1.0)]);
        assert!(plot.svg().starts_with("<svg viewBox"), "{}", &plot.svg()[..80]);
        let html = plot.html();
        for part in ["error &lt;share&gt;", "a &amp; b", "cost, ms", "default", "E &lt;8&gt;"] {
            assert!(html.contains(part), "no {part}");
        }
        assert!(!html.contains("NaN"));
    }

    #[test]
    fn plots_without_points_are_drawn_empty() {
        let mut empty = plot(&[]);
        empty.limit = None;
        empty.ringed = None;
        empty.named.clear();
        assert!(empty.svg().starts_with("<svg"));
        assert!(plot(&[(5.0, 5.0)]).svg().starts_with("<svg"));
    }

    #[test]
    fn axes_have_round_ticks_and_hold_their_values() {
        let axis = Axis::of([0.0, 1e-12, 0.5, 40.0].into_iter(), Scaling::Automatic);
        assert!(axis.is_logarithmic && axis.range[0] > 1e-9 && axis.range[1] > 40.0);
        assert_eq!(axis.place(0.0), axis.range[0].log10());
        let short = Axis::of([3.0, 40.0].into_iter(), Scaling::Logarithmic);
        assert_eq!(short.ticks(), [2.0, 5.0, 10.0, 20.0, 50.0]);
        let linear = Axis::of([-1.0, 5.0].into_iter(), Scaling::Automatic);
        assert_eq!(linear.ticks(), [0.0, 2.0, 4.0]);
        let zeros = Axis::of([0.0, 0.0].into_iter(), Scaling::Automatic);
        assert!(!zeros.is_logarithmic && zeros.range[0] == 0.0 && zeros.range[1] > 0.0);
        assert_eq!((tick(1e-6), tick(2e-7), tick(0.5)), ("10⁻⁶".into(), "2·10⁻⁷".into(), "0.5".into()));
    }

    #[test]
    fn a_front_is_a_staircase_down_to_the_right() {
        let corners = staircase(&[(1.0, 5.0), (2.0, 3.0)], 9.0);
        assert_eq!(corners, [(1.0, 5.0), (2.0, 5.0), (2.0, 3.0), (9.0, 3.0)]);
    }
}

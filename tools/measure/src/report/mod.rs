//! The report: one HTML page for the chart and one for the stability suite, made of the same parts.
//!
//! Readers need not know the code: each figure has a title, units, and one sentence on how to read it. The report
//! computes only quantities that its tables and figures show.

mod compact;
pub mod convergence;
pub mod findings;
pub mod html;
pub mod leaping;
pub mod machine;
pub mod palette;
pub mod pictures;
pub mod plots;
mod reading;
pub mod stability;
pub mod storage;

use crate::chart::Chart;
use crate::convergence::OrderRow;
use crate::leaping::Measured;
use crate::measure::{GREY_LEVELS, INVISIBLE};
use crate::methods::DEFAULT;
use crate::points::Point;
use crate::reading::Read;
use crate::record::RegimeRecord;
use crate::scenes::{SceneSpec, scene};
use crate::storage::Storage;
pub use html::figure;
use html::{Section, escape, paragraph};
pub use machine::Circumstances;
use palette::{ASKED, FAMILIES, STATED};
use plots::{Named, Plot, Scaling, Series, Side};
pub use stability::stability_page;

/// Extent of a report.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Extent {
    /// All results.
    Whole,
    /// All plots and findings, few pictures, no table of all points, the regimes as a table. Small enough for the
    /// repository.
    Summary,
}

/// Inputs of a report.
#[derive(Debug)]
pub struct Report<'a> {
    /// Results of the chart.
    pub chart: &'a Chart,
    /// Orders of convergence; may be empty.
    pub convergence: &'a [OrderRow],
    /// Cost and benefit of empty-space skipping; may be empty.
    pub leaping: &'a [Measured],
    /// Reading cost by requested error; may be empty.
    pub reading: &'a [Read],
    /// Cost of building and storing volumes; may be empty.
    pub storage: &'a Storage,
    /// Results of the stability suite; `None` if it was not run.
    pub stability: Option<&'a [RegimeRecord]>,
    /// Machine, date and command.
    pub here: &'a Circumstances,
    /// Extent of the report.
    pub extent: Extent,
}

/// `report.html`.
#[must_use]
pub fn chart_page(report: &Report<'_>) -> String {
    let chart = report.chart;
    let mut sections = vec![
        Section::new("reading", "How to read this report", how_to_read(chart)),
        Section::new("findings", "What was found", findings::findings(&chart.points)),
        Section::new("speed", "Speed against accuracy", speed_against_accuracy(&chart.points)),
        Section::new("convergence", "Convergence", convergence::section(report.convergence)),
        Section::new("errors", "What an error asked for costs", findings::errors_asked_for(&chart.points)),
        Section::new("stated", "What is stated of each pixel", findings::stated(&chart.stated)),
        Section::new("pictures", "Pictures and their errors", shown_pictures(report)),
        Section::new("storage", "What is read: codecs and storage", findings::storage(&chart.points)),
        Section::new("read", "What is read for the error asked for", reading::section(report.reading, report.extent)),
        Section::new(
            "stored",
            "What is stored: building, bits and decoding",
            storage::section(report.storage, report.extent),
        ),
        Section::new("leaping", "Leaping over what shows nothing", leaping::section(report.leaping)),
        Section::new("stability", "Where methods fail", stability::section(report.stability, report.extent)),
        Section::new("points", "All points", all_points(report)),
        Section::new("notes", "What was not measured", notes(report)),
    ];
    sections.push(html::circumstances(report.here));
    let summary = paragraph(
        "Volume rendering turns a volume into a picture by following a ray through it for every pixel. Ways of doing so \
         differ in how long they take and in how far their picture is from the exact one. This report measures both.",
    );
    html::page("Supervol: speed against accuracy", &summary, &sections)
}

fn how_to_read(chart: &Chart) -> String {
    let [width, height] = chart.image_size;
    let mut names: Vec<&str> = chart.points.iter().map(|p| p.scene.as_str()).collect();
    names.dedup();
    let scenes: Vec<String> = names.iter().filter_map(|n| scene(n)).map(describe).collect();
    let facts = [
        format!(
            "A point is one method on one scene with one transfer function: {} points in all, pictures of {width} × {height} \
             pixels, volumes of at most {} voxels along an edge. A transfer function says which values are seen, in which \
             colour, how opaque.",
            chart.points.len(),
            chart.edge
        ),
        "Error is the distance from the exact picture, which a brute-force integrator computes in double precision from the \
         same trilinear field. It is given as a share of full scale: 1/255 is one grey level of an 8-bit picture, and below \
         half a grey level (the dashed line) nobody can see it. Methods that reconstruct the field in another way (nearest, \
         splines) or store it in other numbers are measured against the same picture: their distance says how different \
         they are."
            .into(),
        "Cost is the processor time of the whole process for one picture, all threads together, once the bricks are in \
         memory: the median of at least three pictures. Error and cost are those of the same picture. The cost of reading \
         is in its own section."
            .into(),
        "The default is what users get without a GPU. It can be asked for an error, the largest of any channel of any pixel \
         (--max-error): the blue curve goes from 8 to 0.1 of 255 grey levels, and its ring is at half a grey level, which is \
         asked for where nobody says otherwise. Methods of comparison run through the same pipeline (the same \
         bricks, the same skipping of empty space); only what happens inside a visible region differs."
            .into(),
    ];
    let shapes = "Transfer functions: smooth is one long ramp, hat a triangle some tenths of the value range wide, step a \
                  surface (nothing below a value, opaque above), spike a triangle two of 256 grey values wide: a thin shell. \
                  Shaded means lit by the default light.";
    let list = format!("<ul>{}</ul>", scenes.concat());
    facts.map(|f| paragraph(&f)).concat() + &paragraph(shapes) + &paragraph("Scenes:") + &list
}

fn describe(spec: &SceneSpec) -> String {
    format!("<li><b>{}</b>: {}</li>", escape(spec.name), escape(spec.about))
}

/// Scenes with pictures in a summary.
const PICTURED_SCENES: [&str; 2] = ["seismic", "carp"];

fn shown_pictures(report: &Report<'_>) -> String {
    let all = &report.chart.pictures;
    if report.extent == Extent::Whole {
        return all.iter().map(|row| pictures::row(row, usize::MAX)).collect();
    }
    // One look per scene, with the pictures of the default and of one other method.
    let of = |scene: &&str| all.iter().find(|row| row.scene == **scene).map(|row| pictures::row(row, 2));
    let shown: String = PICTURED_SCENES.iter().filter_map(of).collect();
    paragraph("Some of them; the others are made by the command below without --summary.") + &shown
}

fn all_points(report: &Report<'_>) -> String {
    match report.extent {
        Extent::Whole => findings::all_points(&report.chart.points),
        Extent::Summary => paragraph(&format!(
            "{} points, which the command below writes to points.csv and points.json, and into this section, without \
             --summary.",
            report.chart.points.len()
        )),
    }
}

fn notes(report: &Report<'_>) -> String {
    let standing = [
        "A GPU's processor time is that of starting it and of waiting for it, so GPU points are never on a Pareto front; \
         an adapter whose name holds \"llvmpipe\" is the processor itself.",
    ];
    let measured = report.chart.notes.iter().chain(&report.storage.notes).cloned();
    let all = standing.iter().map(ToString::to_string).chain(measured);
    format!("<ul class=\"notes\">{}</ul>", all.map(|n| format!("<li>{}</li>", escape(&n))).collect::<String>())
}

/// One plot per scene and look.
fn speed_against_accuracy(points: &[Point]) -> String {
    let mut html = legend(points);
    for of_scene in points.chunk_by(|a, b| a.scene == b.scene) {
        let name = &of_scene[0].scene;
        html += &format!("<h3 id=\"scene-{0}\">{0}</h3>\n", escape(name));
        html += &scene(name).map_or_else(String::new, |spec| paragraph(&format!("Shown: {}.", spec.about)));
        let looks = of_scene.chunk_by(|a, b| a.transfer_function == b.transfer_function);
        html += &html::grid(&looks.map(cost_error_figure).collect::<Vec<_>>());
    }
    html
}

fn cost_error_figure(points: &[Point]) -> String {
    let first = &points[0];
    figure(
        &format!("{}, {}: error against cost", first.scene, first.transfer_function),
        &cost_error_plot(points).html(),
        "Further left is faster, further down is more accurate; the black staircase joins the methods that no other beats in \
         both (the Pareto front), and below the dashed line errors cannot be seen. Above each point of the default, a blue \
         diamond is the error that the picture states, and a blue cross the error asked for.",
    )
}

fn cost_error_plot(points: &[Point]) -> Plot {
    let at = |p: &Point| (p.cpu_ms, p.linf);
    let families = FAMILIES.iter().map(|(family, look)| Series {
        name: (*family).into(),
        look: *look,
        points: in_order_of_cost(points, family).into_iter().map(at).collect(),
    });
    // Above each true error of the default: what the picture states, and what was asked for.
    let curve = in_order_of_cost(points, DEFAULT);
    let beside = |(name, look): (&str, palette::Look), error: fn(&Point) -> Option<f64>| Series {
        name: name.into(),
        look,
        points: curve.iter().filter_map(|p| Some((p.cpu_ms, error(p)?))).collect(),
    };
    let series = families.chain([beside(STATED, |p| p.stated), beside(ASKED, |p| p.max_error)]);
    let ladder = |p: &&Point| Some([p.linf, p.stated?, p.max_error?].map(|error| (p.cpu_ms, error)).to_vec());
    let mut front: Vec<(f64, f64)> = points.iter().filter(|p| p.pareto).map(at).collect();
    front.sort_by(|a, b| a.0.total_cmp(&b.0));
    let default = points.iter().find(|p| p.default);
    Plot {
        x_label: "processor time of one picture, ms".into(),
        y_label: "largest error, share of full scale".into(),
        scaling: [Scaling::Logarithmic; 2],
        series: series.filter(|s| !s.points.is_empty()).collect(),
        guides: curve.iter().filter_map(ladder).collect(),
        front,
        limit: Some((INVISIBLE, "half a grey level".into())),
        ringed: default.map(|p| (p.cpu_ms, p.linf, "default".into())),
        named: ends_of_curve(points),
        has_legend: false,
    }
}

/// Points of a family in the order of their connecting line. The default is sorted by requested error, other families
/// by number of samples, which grows with each swept parameter.
fn in_order_of_cost<'a>(points: &'a [Point], family: &str) -> Vec<&'a Point> {
    let mut of_family: Vec<&Point> = points.iter().filter(|p| p.method == family).collect();
    if family == DEFAULT {
        of_family.sort_by(|a, b| b.max_error.unwrap_or(0.0).total_cmp(&a.max_error.unwrap_or(0.0)));
    } else {
        of_family.sort_by_key(|p| p.samples);
    }
    of_family
}

/// Labels with the requested errors at both ends of the default's curve.
fn ends_of_curve(points: &[Point]) -> Vec<Named> {
    let curve = in_order_of_cost(points, DEFAULT);
    let (&[first, .., last], [left, right]) = (curve.as_slice(), [Side::Left, Side::Right]) else { return Vec::new() };
    let named = |(p, side): (&Point, Side)| {
        let name = format!("{}/255", html::number(p.max_error? * GREY_LEVELS));
        Some(Named { at: (p.cpu_ms, p.linf), name, side })
    };
    [(first, left), (last, right)].into_iter().filter_map(named).collect()
}

/// Marks and names of the families with points.
fn legend(points: &[Point]) -> String {
    let is_shown = |family: &str| points.iter().any(|p| p.method == family);
    let mut shown: Vec<_> = FAMILIES.iter().copied().filter(|(family, _)| is_shown(family)).collect();
    if points.iter().any(|p| p.stated.is_some()) {
        shown.extend([STATED, ASKED]);
    }
    paragraph("Marks mean the same in every figure; lines join one method at different parameters.")
        + &palette::legend(&shown)
}

#[cfg(test)]
mod tests {
    use supervol_scene::image::Image;

    use super::*;
    use crate::chart::PictureRow;
    use crate::points::tests::point;
    use crate::stated::Pixels;

    #[test]
    fn the_page_is_whole_and_fetches_nothing() {
        let image = Image { width: 4, height: 3, pixels: vec![[0.5, 0.2, 0.1, 1.0]; 12] };
        let mut points =
            vec![point(DEFAULT, 1.0, 8e-3), point(DEFAULT, 2.0, 1e-3), point("midpoint samples", 9.0, 1e-2)];
        (points[0].default, points[1].pareto) = (false, true);
        (points[0].max_error, points[1].max_error) = (Some(8.0 / 255.0), Some(0.5 / 255.0));
        (points[0].stated, points[1].stated) = (Some(1.5e-2), Some(1.2e-3));
        let chart = Chart {
            points,
            pictures: vec![PictureRow {
                scene: "thin".into(),
                transfer_function: "spike".into(),
                exact: image.clone(),
                pictures: vec![("midpoint samples".into(), "step 1 voxel".into(), image)],
            }],
            stated: vec![("thin".into(), vec![Pixels::new(1, 0.5).finish()])],
            notes: vec!["scene f3 is <left out>".into()],
            image_size: [4, 3],
            edge: 8,
        };
        let here = Circumstances::now("supervol chart --quick");
        let of = |extent| {
            let storage = &Storage::default();
            chart_page(&Report {
                chart: &chart,
                convergence: &[],
                leaping: &[],
                reading: &[],
                storage,
                stability: None,
                here: &here,
                extent,
            })
        };
        let page = of(Extent::Whole);
        // The default is a curve with named ends; the default error has a ring.
        for part in [
            "<svg",
            "data:image/png;base64,",
            "&lt;left out&gt;",
            "supervol chart --quick",
            ">8/255<",
            ">0.5/255<",
            STATED.0,
            ASKED.0,
        ] {
            assert!(page.contains(part), "no {part}");
        }
        // A summary shows the same plots, but not all points and pictures.
        let summary = of(Extent::Summary);
        let section = |page: &str| {
            page.split("id=\"speed\"").nth(1).map(|rest| rest.split("</section>").next().map(String::from))
        };
        assert_eq!(section(&summary), section(&page));
        assert!(!summary.contains("data:image/png") && !summary.contains("<details>") && summary.contains("3 points"));
        for foreign in ["<script", "http://", "https://", "src=\"/", "url("] {
            assert!(!page.contains(foreign), "{foreign}");
        }
        assert_eq!(page.matches("<section").count(), page.matches("</section>").count());
        assert_eq!(page.matches("<figure>").count(), page.matches("</figure>").count());
    }
}

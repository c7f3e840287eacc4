//! Parsers of colours, cameras, planes and transfer functions.

use std::path::{Path, PathBuf};

use supervol_arguments::failure::Failure;
use supervol_scene::clip::solids::Keep;
use supervol_scene::facts::VolumeFacts;
use supervol_scene::preset::colormap;
use supervol_scene::preset::transfer_file::{TransferFile, TransferFileError};
use supervol_scene::preset::view::Direction;
use supervol_scene::preset::windows::{self, NamedWindow};
use supervol_scene::scene::{BoxSpec, CylinderSpec, PlaneSpec, PointSpec, PointsSpec, SolidSpec, SphereSpec};

/// Requested camera.
#[derive(Debug, Clone, PartialEq)]
pub struct CameraRequest {
    /// Direction of the camera from the middle.
    pub direction: Direction,
    /// Distance from the middle in world units; `None`: chosen.
    pub distance: Option<f64>,
}

/// Plane or solid that clips the volume.
#[derive(Debug, Clone, PartialEq)]
pub enum ClipShape {
    /// Keeps one side of a plane.
    Plane(PlaneSpec),
    /// Keeps the inside or the outside of a solid.
    Solid(Box<SolidSpec>),
}

/// Prefix of a solid that keeps its outside.
const OUTSIDE: &str = "outside-";

/// Named colours.
const COLORS: [(&str, [f64; 3]); 10] = [
    ("black", [0.0; 3]),
    ("white", [1.0; 3]),
    ("grey", [0.5; 3]),
    ("red", [1.0, 0.0, 0.0]),
    ("green", [0.0, 0.6, 0.0]),
    ("blue", [0.0, 0.0, 1.0]),
    ("yellow", [1.0, 1.0, 0.0]),
    ("cyan", [0.0, 1.0, 1.0]),
    ("magenta", [1.0, 0.0, 1.0]),
    ("orange", [1.0, 0.6, 0.0]),
];

/// A direction's name, or `AZ,EL[,DIST]`.
pub fn camera(text: &str) -> Result<CameraRequest, String> {
    let named = |direction| Ok(CameraRequest { direction, distance: None });
    match text {
        "front" => named(Direction::Front),
        "back" => named(Direction::Back),
        "left" => named(Direction::Left),
        "right" => named(Direction::Right),
        "top" => named(Direction::Top),
        "bottom" => named(Direction::Bottom),
        _ => {
            let expected = || {
                format!(
                    "'{text}': expected front, back, left, right, top, bottom, or AZ,EL[,DIST] in degrees and world units"
                )
            };
            let numbers = finite_numbers(text).ok_or_else(expected)?;
            match numbers[..] {
                [azimuth, elevation] => {
                    Ok(CameraRequest { direction: Direction::Angles([azimuth, elevation]), distance: None })
                }
                [azimuth, elevation, distance] if distance > 0.0 => {
                    Ok(CameraRequest { direction: Direction::Angles([azimuth, elevation]), distance: Some(distance) })
                }
                _ => Err(expected()),
            }
        }
    }
}

/// A positive finite number.
pub fn positive(text: &str) -> Result<f64, String> {
    let number = text.trim().parse().ok().filter(|v: &f64| v.is_finite() && *v > 0.0);
    number.ok_or_else(|| format!("'{text}': expected a positive number"))
}

/// A number from 0 to 1.
pub fn share(text: &str) -> Result<f64, String> {
    let number = text.trim().parse().ok().filter(|v: &f64| (0.0..=1.0).contains(v));
    number.ok_or_else(|| format!("'{text}': expected a number from 0 to 1"))
}

/// Percent left out at each end.
pub fn percent(text: &str) -> Result<f64, String> {
    let number = text.trim().trim_end_matches('%').trim().parse().ok().filter(|v: &f64| (0.0..50.0).contains(v));
    number.ok_or_else(|| format!("'{text}': expected a percentage from 0 to below 50"))
}

/// Lengths of the gradient between which opacity rises.
pub fn gradients(text: &str) -> Result<[f64; 2], String> {
    match finite_numbers(text).as_deref() {
        Some(&[from, to]) if 0.0 <= from && from < to => Ok([from, to]),
        _ => Err(format!(
            "'{text}': expected two numbers G0,G1 with 0 <= G0 < G1, data units per world unit (for a step, take a narrow ramp)"
        )),
    }
}

/// Requested window of values.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum WindowRequest {
    /// Least and greatest value.
    Range([f64; 2]),
    /// Named window of tomography.
    Named(NamedWindow),
}

impl WindowRequest {
    /// Least and greatest value for a volume.
    pub fn range(self, facts: &VolumeFacts) -> Result<[f64; 2], Failure> {
        let named = match self {
            Self::Range(range) => return Ok(range),
            Self::Named(named) => named,
        };
        named.range(facts).ok_or_else(|| {
            Failure::Command(format!(
                "--window: a named window needs tomography in Hounsfield units, found data of kind {}; use --kind ct or \
                 ct-offset if this is wrong, or give the window as LOW,HIGH",
                facts.kind.name()
            ))
        })
    }
}

/// LOW,HIGH, or level=L,width=W, or the name of a window.
pub fn window(text: &str) -> Result<WindowRequest, String> {
    if let Some((_, named)) = NamedWindow::NAMES.iter().find(|(name, _)| *name == text) {
        return Ok(WindowRequest::Named(*named));
    }
    let number = |part: Option<&str>| part?.trim().parse().ok().filter(|v: &f64| v.is_finite());
    if let Some((level, width)) = text.split_once(',').filter(|(level, _)| level.trim().starts_with("level")) {
        let level = number(level.trim().strip_prefix("level="));
        let width = number(width.trim().strip_prefix("width=")).filter(|width| *width > 0.0);
        let range = level.zip(width).map(|(level, width)| windows::window_of([level, width]));
        let range = range.filter(|[low, high]| low < high && high.is_finite() && low.is_finite());
        return range.map(WindowRequest::Range).ok_or_else(|| {
            format!("'{text}': expected level=LEVEL,width=WIDTH with a positive width, for example level=50,width=400")
        });
    }
    match finite_numbers(text).as_deref() {
        Some(&[low, high]) if low < high => Ok(WindowRequest::Range([low, high])),
        _ => {
            let names = NamedWindow::NAMES.map(|(name, _)| name).join(", ");
            Err(format!(
                "'{text}': expected two numbers LOW,HIGH with LOW < HIGH, or level=LEVEL,width=WIDTH, or one of {names}"
            ))
        }
    }
}

/// A gamma.
pub fn gamma(text: &str) -> Result<f64, String> {
    let [least, most] = windows::GAMMAS;
    let number = text.trim().parse().ok().filter(|v: &f64| (least..=most).contains(v));
    number.ok_or_else(|| format!("'{text}': expected a number from {least} to {most}"))
}

/// NX,NY,NZ,D, or a solid: its name, a colon, and its numbers or file.
pub fn clip_shape(text: &str) -> Result<ClipShape, String> {
    let Some((name, rest)) = text.split_once(':') else { return plane(text).map(ClipShape::Plane) };
    let (keep, name) = match name.strip_prefix(OUTSIDE) {
        Some(name) => (Keep::Outside, name),
        None => (Keep::Inside, name),
    };
    let numbers = finite_numbers(rest).unwrap_or_default();
    let mut solid = SolidSpec { keep, ..SolidSpec::default() };
    match (name, &numbers[..]) {
        ("sphere", &[x, y, z, radius]) => solid.sphere = Some(SphereSpec { center: [x, y, z], radius }),
        ("box", &[x0, y0, z0, x1, y1, z1]) => {
            let (low, high) = ([x0, y0, z0], [x1, y1, z1]);
            let center = std::array::from_fn(|a| low[a] + 0.5 * (high[a] - low[a]));
            let edges = std::array::from_fn(|a| high[a] - low[a]);
            let axes = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
            solid.cuboid = Some(BoxSpec { center, edges, axes });
        }
        ("cylinder", &[x0, y0, z0, x1, y1, z1, radius]) => {
            solid.cylinder = Some(CylinderSpec { from: [x0, y0, z0], to: [x1, y1, z1], radius });
        }
        // The printed scene may be used in another folder.
        ("mesh", _) if !rest.is_empty() => {
            solid.mesh = Some(std::path::absolute(rest).map_err(|e| format!("{rest}: {e}"))?)
        }
        _ => {
            return Err(format!(
                "'{text}': expected NX,NY,NZ,D, sphere:X,Y,Z,R, box:X0,Y0,Z0,X1,Y1,Z1, cylinder:X0,Y0,Z0,X1,Y1,Z1,R or \
                 mesh:FILE; {OUTSIDE} may precede the name of a solid"
            ));
        }
    }
    Ok(ClipShape::Solid(Box::new(solid)))
}

fn plane(text: &str) -> Result<PlaneSpec, String> {
    match finite_numbers(text).as_deref() {
        Some(&[x, y, z, offset]) if [x, y, z] != [0.0; 3] => Ok(PlaneSpec { normal: [x, y, z], offset }),
        _ => Err(format!("'{text}': expected four numbers NX,NY,NZ,D, the first three not all zero")),
    }
}

/// A colour map: its name, or the file that holds it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum ColorMapRequest {
    /// Built-in colour map.
    Named(String),
    /// Colour map of a file.
    File(PathBuf),
}

/// The name of a colour map, or a file.
pub fn color_map(text: &str) -> Result<ColorMapRequest, String> {
    if colormap::NAMES.contains(&text) {
        return Ok(ColorMapRequest::Named(text.into()));
    }
    if names_file(text) {
        return Ok(ColorMapRequest::File(text.into()));
    }
    Err(format!("'{text}': expected a file (.json, .1dt), or one of {}", colormap::NAMES.join(", ")))
}

impl ColorMapRequest {
    /// Colours at places from 0 to 1.
    pub fn colors(&self) -> Result<Vec<(f64, [f64; 3])>, Failure> {
        match self {
            Self::Named(name) => Ok(colormap::by_name(name).unwrap_or_default()),
            Self::File(path) => {
                let colors = TransferFile::read(path).and_then(|file| file.color_map());
                colors.map_err(|e| Failure::Command(format!("--colormap: {e}")))
            }
        }
    }
}

/// Tests if the text names a file with a transfer function or a colour map.
fn names_file(text: &str) -> bool {
    [".json", ".1dt"].iter().any(|end| text.to_lowercase().ends_with(end)) || Path::new(text).is_file()
}

/// A colour: a name, #rrggbb, or R,G,B from 0 to 1.
pub fn color(text: &str) -> Result<[f64; 3], String> {
    let text = text.trim();
    if let Some((_, color)) = COLORS.iter().find(|(name, _)| *name == text) {
        return Ok(*color);
    }
    let hex = text.strip_prefix('#').filter(|digits| digits.len() == 6 && digits.is_ascii());
    if let Some(number) = hex.and_then(|digits| u32::from_str_radix(digits, 16).ok()) {
        return Ok([16, 8, 0].map(|shift| f64::from(number >> shift & 255) / 255.0));
    }
    match finite_numbers(text).as_deref() {
        Some(&[r, g, b]) if [r, g, b].iter().all(|c| (0.0..=1.0).contains(c)) => Ok([r, g, b]),
        _ => {
            let names: Vec<&str> = COLORS.iter().map(|(name, _)| *name).collect();
            Err(format!("'{text}': expected one of {}, #rrggbb, or R,G,B from 0 to 1", names.join(", ")))
        }
    }
}

/// Requested surface inside the volume.
#[derive(Debug, Clone, PartialEq)]
pub struct SurfaceRequest {
    /// Data value.
    pub value: f64,
    /// Colour, each channel in [0, 1]; `None`: default.
    pub color: Option<[f64; 3]>,
    /// Opacity in [0, 1].
    pub alpha: f64,
}

/// `VALUE[:COLOUR[:OPACITY]]`.
pub fn surface(text: &str) -> Result<SurfaceRequest, String> {
    let expected = || format!("'{text}': expected VALUE, VALUE:COLOUR or VALUE:COLOUR:OPACITY, such as 300:white:0.5");
    let mut parts = text.split(':');
    let value = parts.next().and_then(|value| value.trim().parse().ok()).filter(|v: &f64| v.is_finite());
    let color = parts.next().map(color).transpose()?;
    let alpha = parts.next().map_or(Ok(1.0), share)?;
    match (value, parts.next()) {
        (Some(value), None) => Ok(SurfaceRequest { value, color, alpha }),
        _ => Err(expected()),
    }
}

/// `VALUE:COLOUR:OPACITY,...`, or a file with a transfer function.
pub fn transfer_function(text: &str, facts: &VolumeFacts) -> Result<PointsSpec, Failure> {
    if names_file(text) {
        let points = TransferFile::read(Path::new(text)).and_then(|file| file.points(facts));
        return points.map_err(|error| {
            let option =
                if matches!(error, TransferFileError::NoOpacities { .. }) { " (option --colormap)" } else { "" };
            Failure::Command(format!("--tf: {error}{option}"))
        });
    }
    points(text)
}

fn points(text: &str) -> Result<PointsSpec, Failure> {
    let point = |part: &str| -> Result<PointSpec, String> {
        let expected = || format!("'{part}': expected VALUE:COLOUR:OPACITY, such as 300:white:0.4 or 300:#ffddaa:0.4");
        let [value, color_text, alpha] = part.split(':').collect::<Vec<_>>()[..] else { return Err(expected()) };
        let number = |text: &str| text.trim().parse::<f64>().ok().filter(|v| v.is_finite());
        let alpha = number(alpha).filter(|a| (0.0..=1.0).contains(a));
        match (number(value), alpha) {
            (Some(value), Some(alpha)) => Ok(PointSpec { value, color: color(color_text)?, alpha }),
            _ => Err(expected()),
        }
    };
    let points: Result<Vec<_>, _> = text.split(',').map(point).collect();
    let points = points.map_err(|e| Failure::Command(format!("--tf {e}, or a file (.json, .1dt)")))?;
    Ok(PointsSpec { unit_distance: None, points })
}

fn finite_numbers(text: &str) -> Option<Vec<f64>> {
    text.split(',').map(|t| t.trim().parse().ok().filter(|v: &f64| v.is_finite())).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn looks_are_read_as_people_write_them() {
        assert_eq!(color("#ff8000"), Ok([1.0, 128.0 / 255.0, 0.0]));
        assert_eq!(color("0.1, 0.2,1"), Ok([0.1, 0.2, 1.0]));
        assert_eq!(color("white"), Ok([1.0; 3]));
        for text in ["#ff80", "1,2,3", "blanc", "#gggggg", ""] {
            assert!(color(text).is_err_and(|e| e.contains("expected")), "{text}");
        }
        assert_eq!(camera("30,-20").map(|w| w.direction), Ok(Direction::Angles([30.0, -20.0])));
        assert_eq!(camera("30,20,5").map(|w| w.distance), Ok(Some(5.0)));
        for text in ["up", "1", "1,2,3,4", "1,2,-3", "nan,0"] {
            assert!(camera(text).is_err(), "{text}");
        }
        assert_eq!(window("-5,7"), Ok(WindowRequest::Range([-5.0, 7.0])));
        assert!(window("7,-5").is_err() && window("1").is_err());
        assert_eq!(percent("2.5%"), Ok(2.5));
        assert!(percent("50").is_err() && plane("0,0,0,1").is_err() && positive("0").is_err());
        let Ok(ClipShape::Solid(solid)) = clip_shape("outside-box:0,0,0,2,4,6") else { panic!("a box") };
        let cuboid = solid.cuboid.expect("a box");
        assert_eq!((solid.keep, cuboid.center, cuboid.edges), (Keep::Outside, [1.0, 2.0, 3.0], [2.0, 4.0, 6.0]));
        assert!(matches!(clip_shape("1,0,0,5"), Ok(ClipShape::Plane(_))) && clip_shape("mesh:a:b.ply").is_ok());
        assert!(["sphere:1,2,3", "ball:1,2,3,4", "mesh:", "1,2,3"].iter().all(|text| clip_shape(text).is_err()));
        let request = SurfaceRequest { value: -3.5, color: Some([1.0; 3]), alpha: 0.25 };
        assert_eq!(surface("-3.5:white:0.25"), Ok(request));
        assert_eq!(surface("7").map(|request| (request.color, request.alpha)), Ok((None, 1.0)));
        assert!(["", "a", "1:", "1:white:2", "1:white:1:1"].iter().all(|text| surface(text).is_err()));
        let read = points("0:black:0,100:#ffffff:0.5").expect("two points").points;
        assert_eq!((read.len(), read[1].color, read[1].alpha), (2, [1.0; 3], 0.5));
        assert!(points("0:black").is_err() && points("0:black:2").is_err());
        assert_eq!(color_map("viridis"), Ok(ColorMapRequest::Named("viridis".into())));
        assert!(matches!(color_map("Map.JSON"), Ok(ColorMapRequest::File(_))) && color_map("jet").is_err());
    }
}

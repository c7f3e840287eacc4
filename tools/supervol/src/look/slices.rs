//! Options of slices: `--slice` and those that need it.

use clap::{Args, ValueEnum};
use glam::DVec3;
use supervol_arguments::failure::Failure;
use supervol_arguments::scene::ModeName;
use supervol_format::Container;
use supervol_scene::facts::{DataKind, VolumeFacts};
use supervol_scene::preset::slices::{middle_slices, plane_across};
use supervol_scene::preset::windows::Paint;
use supervol_scene::preset::{Look, ramps};
use supervol_scene::scene::section::{Slab, SlabMode, Slice, face_on};
use supervol_scene::scene::{Mode, PointSpec, Scene, TransferFunctionSpec};
use supervol_scene::slices::filter::{FilterKind, FilterSpec};
use supervol_scene::slices::{ColorSpec, Interpolation, SliceSpec};
use supervol_scene::transfer_function::ControlPoint;

use super::parse;
use super::places::{self, Cut, PlaneCoordinates};

/// Slices, and how they are drawn.
#[derive(Debug, Clone, Args)]
pub struct SliceArguments {
    /// Show a slice face on: AXIS=PLACE, or normal=NX,NY,NZ@X,Y,Z for any plane
    ///
    /// AXIS is one of the axes of --crop, PLACE a coordinate on it or `middle`, for example "inline 10123". Between two
    /// lines, values are interpolated, and a note says so. The plane has the given normal and passes through the point
    /// X,Y,Z; without a point, it passes through the middle. Both are in the coordinates of --pick; see --coordinates. Repeat the option for
    /// several slices side by side.
    #[arg(long = "slice", value_name = "AXIS=PLACE|normal=...", value_parser = places::slice, allow_hyphen_values = true)]
    pub cuts: Vec<Cut>,
    /// Place of the slices: side by side, or inside the picture of the volume [default: panels; volume with --mode slice]
    ///
    /// If the default picture of the volume would hide slices inside it, the volume is drawn fainter; --opacity makes it
    /// denser again.
    #[arg(long, value_enum, requires = "cuts")]
    slices: Option<Where>,
    /// Thickness of the slice in voxels: shows the mean across it, or the quantity of --slab-mode
    #[arg(long, value_name = "VOXELS", value_parser = parse::positive, requires = "cuts")]
    slab: Option<f64>,
    /// Quantity that a slab shows: mean, maximum or minimum of the values across it
    #[arg(long, value_enum, default_value = "mean", requires = "slab")]
    slab_mode: SlabModeName,
    /// Interpolation between voxels on slices
    #[arg(long, value_enum, default_value = "linear", requires = "cuts")]
    interpolation: InterpolationName,
    /// Opacity of slices inside the picture of the volume: 0 to 1
    #[arg(long, value_name = "SHARE", value_parser = parse::share, requires = "cuts")]
    slice_opacity: Option<f64>,
    /// Image filter on slices: gaussian, median, sobel, laplacian or marr-hildreth, with a size in voxels behind a
    /// colon [default size: 1]
    ///
    /// The size of gaussian and marr-hildreth is the standard deviation, for example gaussian:2. The size of median
    /// is the radius of its window.
    #[arg(long, value_name = "NAME[:SIZE]", value_parser = filter, requires = "cuts")]
    filter: Option<FilterSpec>,
}

/// Colours of a slice that is shown face on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PanelColors {
    /// The colours that suit the kind of data.
    OfKind,
    /// Labels as grey numbers; options change the colours.
    Painted,
}

/// Place of the slices.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Where {
    /// Face on, side by side
    Panels,
    /// Inside the picture of the volume
    Volume,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum SlabModeName {
    /// Mean across the slab
    Mean,
    /// Greatest value across the slab
    Max,
    /// Least value across the slab
    Min,
}

impl From<SlabModeName> for SlabMode {
    fn from(name: SlabModeName) -> Self {
        match name {
            SlabModeName::Mean => Self::Mean,
            SlabModeName::Max => Self::Max,
            SlabModeName::Min => Self::Min,
        }
    }
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum InterpolationName {
    /// Value of the nearest voxel
    Nearest,
    /// Trilinear, as in volumes
    Linear,
    /// Cubic (Catmull and Rom)
    Cubic,
}

fn filter(text: &str) -> Result<FilterSpec, String> {
    let (name, size) = match text.split_once(':') {
        Some((name, size)) => (name, Some(size)),
        None => (text, None),
    };
    let known = FilterKind::NAMES.iter().find(|(known, _)| *known == name);
    let names = || FilterKind::NAMES.map(|(name, _)| name).join(", ");
    let &(_, kind) = known.ok_or_else(|| format!("'{text}': expected one of {}", names()))?;
    let Some(size) = size else { return Ok(FilterSpec { kind, size: None }) };
    let Some([least, most]) = kind.sizes() else { return Err(format!("'{text}': {name} has no size")) };
    let number = size.trim().parse().ok().filter(|size| (least..=most).contains(size));
    let number = number.ok_or_else(|| format!("'{text}': expected a size from {least} to {most} voxels"))?;
    Ok(FilterSpec { kind, size: Some(number) })
}

impl SliceArguments {
    /// True if each slice is a picture of its own, face on. `mode` is the requested mode.
    pub fn are_panels(&self, mode: Option<ModeName>) -> bool {
        let usual = if mode == Some(ModeName::Slice) { Where::Volume } else { Where::Panels };
        !self.cuts.is_empty() && self.slices.unwrap_or(usual) == Where::Panels
    }

    /// Notes about the positions of the slices.
    pub fn notes(&self, container: &Container) -> Vec<String> {
        self.cuts.iter().filter_map(|cut| cut.note(container)).collect()
    }

    /// The options with only this slice.
    pub fn only(&self, cut: &Cut) -> Self {
        Self { cuts: vec![cut.clone()], ..self.clone() }
    }

    /// Scene that shows only this slice, face on.
    pub fn panel(
        &self,
        scene: &Scene,
        cut: &Cut,
        place: (&Container, &VolumeFacts, PlaneCoordinates),
        (zoom, colors): (f64, PanelColors),
    ) -> Result<Scene, Failure> {
        let (container, facts, _) = place;
        let nothing = || Failure::Command(format!("--slice {cut} lies outside the volume, or outside --crop"));
        let is_plain = self.interpolation == InterpolationName::Linear && self.filter.is_none();
        if self.slice_opacity.is_some() {
            return Err(Failure::Command(
                "--slice-opacity needs --slices volume: slices that are shown face on are opaque".into(),
            ));
        }
        if facts.kind == DataKind::Labels && self.slab.is_some() {
            return Err(Failure::Command(
                "--slab shows a mean or an extreme, and that of label numbers is no label: remove it, or add --kind generic \
                 to treat the numbers as values"
                    .into(),
            ));
        }
        // Labels are drawn by their nearest voxel, unless their numbers are to be painted as values.
        let is_of_labels = facts.kind == DataKind::Labels && scene.transfer_function.is_none() && self.slab.is_none();
        let shows_labels = is_of_labels && colors == PanelColors::OfKind && self.shows_labels();
        if let (Cut::Across(place), true) = (cut, is_plain && !shows_labels) {
            let (axis, at) = place.on_grid(container, facts)?;
            let colors = match colors {
                PanelColors::OfKind => ramps::of_slice(facts),
                PanelColors::Painted => ramps::plain_slice(facts),
            };
            let slab = self.slab.map(|thickness| Slab { thickness, mode: self.slab_mode.into() });
            return Slice { axis, at, slab, zoom }.of(scene, facts, &colors).ok_or_else(nothing);
        }
        self.refuse_slab()?;
        let mut slice = self.spec(cut, place)?;
        if let Some(TransferFunctionSpec::Points(points)) = &scene.transfer_function {
            slice.colors =
                points.points.iter().map(|p: &PointSpec| ColorSpec { value: p.value, color: p.color }).collect();
        }
        if shows_labels {
            (slice.labels, slice.interpolation) = (true, Interpolation::Nearest);
        }
        face_on(scene, facts, slice, zoom).ok_or_else(nothing)
    }

    /// Adds all slices to the picture of the volume. Mode `slice` without slices gets those through the middle.
    pub fn add_to(
        &self,
        scene: &mut Scene,
        place: (&Container, &VolumeFacts, PlaneCoordinates),
    ) -> Result<(), Failure> {
        let (_, facts, _) = place;
        if self.cuts.is_empty() {
            if scene.mode == Some(Mode::Slice) && scene.slices.is_empty() {
                scene.slices = middle_slices(facts);
            }
            return Ok(());
        }
        self.refuse_slab()?;
        for cut in &self.cuts {
            scene.slices.push(self.spec(cut, place)?);
        }
        // Projections have no depth. If no mode was requested, the volume is drawn in mode dvr.
        let is_projected = !matches!(Look::of(facts).mode, Mode::Dvr | Mode::Iso);
        if scene.mode.is_none() && scene.iso.is_empty() && is_projected {
            scene.mode = Some(Mode::Dvr);
        }
        Ok(())
    }

    /// Whether these slices can show labels: without a filter, and not cubic.
    fn shows_labels(&self) -> bool {
        self.filter.is_none() && self.interpolation != InterpolationName::Cubic
    }

    fn refuse_slab(&self) -> Result<(), Failure> {
        match self.slab {
            Some(_) => Err(Failure::Command(
                "--slab needs a slice across an axis, shown face on, with linear interpolation and without --filter"
                    .into(),
            )),
            None => Ok(()),
        }
    }

    fn spec(
        &self,
        cut: &Cut,
        (container, facts, coordinates): (&Container, &VolumeFacts, PlaneCoordinates),
    ) -> Result<SliceSpec, Failure> {
        let (normal, offset) = match cut {
            Cut::Across(place) => {
                let (axis, at) = place.on_grid(container, facts)?;
                plane_across(facts, axis, at)
            }
            Cut::Plane { normal, through } => {
                let middle = || {
                    let index = DVec3::from_array(facts.dims.0.map(|n| 0.5 * (n as f64 - 1.0)));
                    facts.geometry.world_from_index().transform_point3(index)
                };
                let offset = through.map(|through| DVec3::from_array(*normal).dot(through.into()));
                let (normal, offset) = match offset {
                    Some(offset) => coordinates.plane_in_world(*normal, offset, container, facts),
                    None => {
                        let (normal, _) = coordinates.plane_in_world(*normal, 0.0, container, facts);
                        (normal, DVec3::from_array(normal).dot(middle()))
                    }
                };
                (normal, offset)
            }
        };
        let interpolation = match self.interpolation {
            InterpolationName::Nearest => Interpolation::Nearest,
            InterpolationName::Linear => Interpolation::Linear,
            InterpolationName::Cubic => Interpolation::Cubic,
        };
        let opacity = self.slice_opacity.unwrap_or(1.0);
        Ok(SliceSpec { normal, offset, opacity, interpolation, filter: self.filter, colors: Vec::new(), labels: false })
    }
}

/// Shows the numbers of labels as values, so that they can have a window and colours.
pub fn show_numbers(slice: &mut SliceSpec, facts: &VolumeFacts) {
    slice.labels = false;
    slice.colors = ramps::plain_slice(facts).iter().map(|p| ColorSpec { value: p.value, color: p.color }).collect();
}

/// Changes window and colours of a slice, as far as they are given.
pub fn repaint(slice: &mut SliceSpec, paint: &Paint<'_>) -> Result<(), Failure> {
    let point = |value, color| ControlPoint { value, color, alpha: 1.0 };
    let points: Vec<ControlPoint> = match (&slice.colors[..], paint.window) {
        // Filtered values have another range.
        ([], None) => {
            return Err(Failure::Command(
                "--colormap and --gamma need --window here: this --filter changes the range of values".into(),
            ));
        }
        ([], Some([low, high])) => vec![point(low, [0.0; 3]), point(high, [1.0; 3])],
        (known, _) => known.iter().map(|c| point(c.value, c.color)).collect(),
    };
    let painted = paint.applied(&points);
    slice.colors = painted.iter().map(|p| ColorSpec { value: p.value, color: p.color }).collect();
    Ok(())
}

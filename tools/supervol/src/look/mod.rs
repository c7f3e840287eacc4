//! Options of `render` that change the scene: each changes one part of it.
//!
//! The options change the scene of the scene file, else the default scene. An option that would change nothing in the
//! drawn mode is refused.

mod parse;
pub mod places;
mod slices;
pub mod warnings;

use clap::Args;
use supervol::{PlacedVolume, Volume};
use supervol_arguments::failure::Failure;
use supervol_arguments::quantity;
use supervol_arguments::scene::ModeName;
use supervol_format::Container;
use supervol_scene::facts::{DataKind, VolumeFacts};
use supervol_scene::preset::overview::Overview;
use supervol_scene::preset::view::{Framed, View, upright};
use supervol_scene::preset::windows::Paint;
use supervol_scene::preset::{looks, ramps};
use supervol_scene::scene::{
    CameraSpec, ClipSpec, ImageSpec, IsoSpec, Mode, PlaneSpec, PointsSpec, Scene, ShadingSpec, SolidSpec,
    TransferFunctionSpec,
};
use supervol_scene::transfer_function::times_extinction;

use self::parse::{CameraRequest, ClipShape, ColorMapRequest, SurfaceRequest, WindowRequest};
use self::places::{Crop, Cut, PlaneCoordinates};
use self::slices::{PanelColors, SliceArguments};
use crate::grid::{Grid, PANEL_LIMIT};

/// Volume, camera and appearance.
#[derive(Debug, Clone, Args)]
#[command(next_help_heading = "Scene")]
pub struct LookArguments {
    /// Kind of data, if it is not recognised correctly
    ///
    /// One of seismic, attribute, ct, ct-offset, mri, fluorescence, em, micro-ct, labels, mask, constant, empty or
    /// generic. `info` prints the recognised kind and the reason.
    #[arg(long, value_name = "KIND", visible_alias = "preset")]
    kind: Option<DataKind>,
    /// Rendering mode: quantity that a ray computes
    ///
    /// Mode slice draws the slices of --slice in place, for example a fence. Without --slice, it draws three planes
    /// through the middle.
    #[arg(long, value_enum)]
    mode: Option<ModeName>,
    /// Size of the picture in pixels: 1 to 32768 each, for example 1024x768
    #[arg(long, value_name = "WxH", value_parser = quantity::image_size)]
    size: Option<[u32; 2]>,
    /// Position of the camera: front, back, left, right, top, bottom, or angles AZ,EL in degrees, for example 30,20
    ///
    /// A third number is the distance from the volume in world units, for example 30,20,1500. Without it, the volume
    /// fills the picture.
    #[arg(long, value_name = "DIRECTION|AZ,EL[,DIST]", value_parser = parse::camera, allow_hyphen_values = true)]
    camera: Option<CameraRequest>,
    /// Magnification: 1 shows the volume as large as it fits, 2 twice as large
    #[arg(long, value_name = "FACTOR", value_parser = parse::positive, allow_negative_numbers = true)]
    zoom: Option<f64>,
    /// Transfer function: points VALUE:COLOUR:OPACITY,... or a file, for example 0:black:0,300:white:0.4
    ///
    /// Colours are written as in --background. A file is JSON with `points` and `unit_distance` as in a scene, a
    /// colour map of ParaView with opacities (.json), or a table of ImageVis3D (.1dt).
    #[arg(long, value_name = "FILE|POINTS", allow_hyphen_values = true)]
    tf: Option<String>,
    /// Colour map by name, or of a file as for --tf
    ///
    /// Names: grey, seismic, viridis, magma, inferno, plasma, cividis, turbo, cubehelix, warm, cool and spectral.
    #[arg(long, value_name = "NAME|FILE", value_parser = parse::color_map)]
    colormap: Option<ColorMapRequest>,
    /// Range of data values that colours and opacities span: LOW,HIGH, level=LEVEL,width=WIDTH, or a name
    ///
    /// Examples: -100,400 and level=150,width=500 are the same range. Names are bone (level 400, width 1800), lung (-600,
    /// 1500), soft-tissue (50, 400) and brain (40, 80). They need tomography in Hounsfield units.
    #[arg(long, value_name = "LOW,HIGH|NAME", value_parser = parse::window, allow_hyphen_values = true)]
    window: Option<WindowRequest>,
    /// Set that range by percentiles: leave out this percentage of the voxels at each end, 0 to below 50
    #[arg(long, value_name = "PERCENT", value_parser = parse::percent, allow_negative_numbers = true, conflicts_with = "window")]
    clip_percent: Option<f64>,
    /// Gamma of the colours over their range of values: 0.1 to 10, default 1; below 1 brightens a grey picture
    ///
    /// The value at share x of the range gets the colour at share x^GAMMA. Opacities stay the same.
    #[arg(long, value_name = "GAMMA", value_parser = parse::gamma, allow_negative_numbers = true)]
    gamma: Option<f64>,
    /// Density: multiplies the extinction (mode dvr) or the opacity of surfaces (mode iso); 1 changes nothing
    ///
    /// In mode dvr, opacity 1 counts as 0.9999, so that factors below 1 make opaque data translucent.
    #[arg(long, value_name = "FACTOR", value_parser = parse::positive, allow_negative_numbers = true)]
    opacity: Option<f64>,
    /// Opacity by the gradient (mode dvr): none up to length G0, rising to all of it at G1, in data units per world unit
    ///
    /// Shows boundaries, and makes even regions transparent. `histogram --gradient` prints the lengths that occur.
    #[arg(long, value_name = "G0,G1", value_parser = parse::gradients, allow_hyphen_values = true, conflicts_with = "iso")]
    gradient_opacity: Option<[f64; 2]>,
    /// Light the faces of cuts by the cut's own normal (mode dvr), not by the gradient of the data behind them
    ///
    /// Cuts are those of --crop and --clip. Their faces are then evenly bright where data are noisy. The cut's light fades into
    /// that of the gradient from 2 to 4 voxels behind a face. It turns on the default light where the picture has none.
    #[arg(long, conflicts_with_all = ["iso", "unlit"])]
    cut_normals: bool,
    /// Isosurfaces at these data values (mode iso); all but the last are semi-transparent
    #[arg(long, value_name = "V[,V..]", value_delimiter = ',', allow_hyphen_values = true)]
    iso: Vec<f64>,
    /// Isosurface inside the semi-transparent volume (mode dvr): VALUE, VALUE:COLOUR or VALUE:COLOUR:OPACITY
    ///
    /// Example: 300:white:0.5. Repeat the option for up to 8 surfaces.
    #[arg(long, value_name = "VALUE[:COLOUR[:OPACITY]]", value_parser = parse::surface, allow_hyphen_values = true)]
    #[arg(conflicts_with = "iso")]
    surface: Vec<SurfaceRequest>,
    /// Show only this box: voxels I0:I1,J0:J1,K0:K1 (ends are excluded), or ranges AXIS=FROM:TO,...
    ///
    /// Axes: i, j, k (voxels); x, y, z (world); inline, crossline, time or depth; sagittal, coronal, axial (world); axes
    /// with names of the file. Coordinates are those on the axes of --decorate and of --pick; vertical exaggeration
    /// changes none. Example: inline=100:200.
    #[arg(long, value_name = "BOX", value_parser = places::crop, allow_hyphen_values = true)]
    crop: Option<Crop>,
    /// Show only one side of a plane, or only the inside or outside of a solid
    ///
    /// Plane NX,NY,NZ,D keeps x * NX + y * NY + z * NZ >= D. Its numbers are coordinates of --pick: easting, northing
    /// and time or depth of a survey on the map, millimetres of a patient, else world units; see --coordinates. Numbers
    /// of solids are world units. Solids: sphere:X,Y,Z,R, box:X0,Y0,Z0,X1,Y1,Z1,
    /// cylinder:X0,Y0,Z0,X1,Y1,Z1,R, and mesh:FILE (a closed triangle mesh: .ply, .stl or .obj). The prefix
    /// `outside-`, as in outside-sphere:, keeps the outside. Repeat the option for several cuts: the picture shows
    /// their intersection.
    #[arg(long, value_name = "NX,NY,NZ,D|SOLID", value_parser = parse::clip_shape, allow_hyphen_values = true)]
    clip: Vec<ClipShape>,
    /// Coordinates of planes in --clip and --slice normal=...: those of the volume's place, or those of its own world
    #[arg(long, value_enum, default_value = "place")]
    coordinates: PlaneCoordinates,
    /// Show the table below a patient: the default picture of tomography leaves it out
    ///
    /// The table is found as a long, flat part below the body that is not connected to it. Planes cut it away, and a note
    /// says so. Other pictures, such as those of --mode dvr, show it.
    #[arg(long)]
    keep_table: bool,
    #[command(flatten)]
    slices: SliceArguments,
    /// Draw without lighting
    #[arg(long)]
    unlit: bool,
    /// Factor for heights or depths, for example 5
    #[arg(long, value_name = "FACTOR", value_parser = parse::positive, allow_negative_numbers = true)]
    vertical_exaggeration: Option<f64>,
    /// Background colour: a name such as black, white or grey, #rrggbb, or R,G,B from 0 to 1
    #[arg(long, value_name = "COLOUR", value_parser = parse::color)]
    background: Option<[f64; 3]>,
    /// Number of rays along each edge of a pixel: 1 to 16; N means N x N rays a pixel
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=16))]
    supersample: Option<u32>,
}

/// Opacity of all surfaces except the last.
const CLEAR_SURFACE: f64 = 0.35;
/// Colours of these surfaces, starting with the first.
const CLEAR_COLORS: [[f64; 3]; 4] = [[0.82, 0.50, 0.38], [0.35, 0.60, 0.85], [0.45, 0.75, 0.40], [0.85, 0.75, 0.35]];

impl LookArguments {
    /// The volume of a container, of the given or recognised kind.
    pub fn volume(&self, container: Container) -> Volume {
        let volume = Volume::of(container);
        match self.kind {
            Some(kind) => volume.with_kind(kind),
            None => volume,
        }
    }

    /// The volume for drawing, with the requested vertical exaggeration.
    pub fn placed(&self, volume: &Volume, scene: &Scene) -> Result<PlacedVolume, Failure> {
        let vertical_exaggeration = self.vertical_exaggeration.or(scene.vertical_exaggeration);
        volume.placed_for(&Scene { vertical_exaggeration, ..Scene::default() }).map_err(Failure::command)
    }

    /// Tests if [`Self::scene`] needs an overview of the volume: for the camera or the values of projections.
    pub fn asks_overview(&self, scene: &Scene) -> bool {
        let leaves_open = scene.camera.is_none() || scene.transfer_function.is_none();
        leaves_open || self.camera.is_some() || self.zoom.is_some()
    }

    /// If several slices are requested: the options of each slice, and the grid of panels.
    pub fn panels(&self, scene: &Scene) -> Result<Option<(Vec<Self>, Grid)>, Failure> {
        let cuts = &self.slices.cuts;
        if self.shows_panels() {
            self.check_panels()?;
        }
        if !self.shows_panels() || cuts.len() < 2 {
            return Ok(None);
        }
        let size = self.size.unwrap_or([scene.image.width, scene.image.height]);
        let grid = (cuts.len() <= PANEL_LIMIT).then(|| Grid::of(cuts.len(), size)).flatten();
        let grid = grid.ok_or_else(|| {
            let [width, height] = size;
            Failure::Command(format!(
                "--slice: expected at most {PANEL_LIMIT} slices of at least one pixel, found {} in a picture of {width} x {height}",
                cuts.len()
            ))
        })?;
        let alone = |cut: &Cut| Self { slices: self.slices.only(cut), size: Some(grid.size), ..self.clone() };
        Ok(Some((cuts.iter().map(alone).collect(), grid)))
    }

    /// True if slices are shown face on.
    pub fn shows_panels(&self) -> bool {
        self.slices.are_panels(self.mode)
    }

    /// Notes about the positions of the slices.
    pub fn notes(&self, container: &Container) -> Vec<String> {
        self.slices.notes(container)
    }

    /// Note about a table that the scene of [`Self::scene`] leaves out; `None` if there is none.
    pub fn note_of_table(&self, scene: &Scene, overview: Option<&Overview>) -> Option<String> {
        let table = overview.filter(|_| !self.keep_table)?.table();
        let is_cut = !table.is_empty() && scene.clip.planes == table;
        let planes = if table.len() == 1 { "1 plane".into() } else { format!("{} planes", table.len()) };
        is_cut.then(|| format!("the table below the body is cut away by {planes}; --keep-table shows it"))
    }

    /// Name of the requested kind of data.
    pub fn kind_name(&self) -> Option<&'static str> {
        self.kind.map(DataKind::name)
    }

    /// True if a background colour is requested.
    pub fn has_background(&self) -> bool {
        self.background.is_some()
    }

    /// Names of the shown slices.
    pub fn name(&self) -> String {
        self.slices.cuts.iter().map(ToString::to_string).collect::<Vec<_>>().join(" ")
    }

    /// Refuses options of volumes if slices are shown face on.
    fn check_panels(&self) -> Result<(), Failure> {
        let of_volumes = [
            ("--mode", self.mode.is_some()),
            ("--iso", !self.iso.is_empty()),
            ("--surface", !self.surface.is_empty()),
            ("--opacity", self.opacity.is_some()),
            ("--gradient-opacity", self.gradient_opacity.is_some()),
            ("--cut-normals", self.cut_normals),
            ("--unlit", self.unlit),
            ("--camera", self.camera.is_some()),
        ];
        match of_volumes.iter().find(|(_, given)| *given) {
            Some((option, _)) => Err(Failure::Command(format!(
                "{option} changes nothing on a slice that is shown face on; use --slices volume to show slices inside the volume"
            ))),
            None => Ok(()),
        }
    }

    /// The complete scene with all options applied.
    pub fn scene(
        &self,
        scene: &Scene,
        container: &Container,
        facts: &VolumeFacts,
        overview: Option<&Overview>,
    ) -> Result<Scene, Failure> {
        let with_table = overview.filter(|_| self.keep_table).map(Overview::with_table);
        let overview = with_table.as_ref().or(overview);
        let mut scene = scene.clone();
        self.set_image(&mut scene.image);
        if let Some(crop) = &self.crop {
            scene.clip.index_box = Some(crop.in_voxels(container, facts)?);
        }
        for clip_shape in &self.clip {
            match clip_shape {
                ClipShape::Plane(plane) => {
                    let [a, b, c] = plane.normal;
                    let (normal, offset) = self.coordinates.plane_in_world([a, b, c], plane.offset, container, facts);
                    scene.clip.planes.push(PlaneSpec { normal, offset });
                }
                ClipShape::Solid(solid) => scene.clip.solids.push(SolidSpec::clone(solid)),
            }
        }
        let (says_light, had_no_surface) = (scene.shading.is_some(), scene.iso.is_empty());
        self.set_mode(&mut scene, facts, overview);
        self.add_surfaces(&mut scene, facts)?;
        let lacks_light = self.cut_normals && !matches!(scene.shading, Some(Some(_)));
        if (!self.surface.is_empty() || lacks_light) && !says_light {
            // Surfaces need lighting to be visible, whatever the kind of data, and so do faces of cuts.
            scene.shading = Some(Some(ShadingSpec::default()));
        }
        scene.cut_normals |= self.cut_normals;
        scene.gradient_opacity = self.gradient_opacity.or(scene.gradient_opacity);
        if let Some(text) = &self.tf {
            scene.transfer_function = Some(TransferFunctionSpec::Points(parse::transfer_function(text, facts)?));
        }
        if self.vertical_exaggeration.is_some() {
            scene.vertical_exaggeration = self.vertical_exaggeration.filter(|factor| *factor != 1.0);
        }
        match &self.slices.cuts[..] {
            [cut] if self.shows_panels() => {
                let colors = if self.paints() { PanelColors::Painted } else { PanelColors::OfKind };
                let look = (self.zoom.unwrap_or(1.0), colors);
                scene = self.slices.panel(&scene, cut, (container, facts, self.coordinates), look)?;
            }
            _ => self.slices.add_to(&mut scene, (container, facts, self.coordinates))?,
        }
        let has_usual_surface = self.iso.is_empty() && self.surface.is_empty() && had_no_surface;
        if has_usual_surface && !scene.slices.is_empty() {
            scene.iso.iter_mut().for_each(|iso| iso.alpha = looks::SURFACE_AROUND_SLICES);
        }
        if let Some(n) = self.supersample {
            scene.samples_per_pixel = Some(n * n);
        }
        if self.camera.is_some() || self.zoom.is_some() {
            self.set_camera(&mut scene, facts, overview);
        }
        let mut scene = scene.complete(facts, overview);
        self.repaint(&mut scene, facts)?;
        if self.unlit {
            self.remove_shading(&mut scene)?;
        }
        scene.validate().map_err(Failure::command)?;
        if self.cut_normals && scene.clip == ClipSpec::default() {
            return Err(Failure::Command("--cut-normals changes nothing without a cut; add --clip or --crop".into()));
        }
        scene.validate_cuts().map_err(Failure::command)?;
        Ok(scene)
    }

    fn set_image(&self, image: &mut ImageSpec) {
        if let Some([width, height]) = self.size {
            (image.width, image.height) = (width, height);
        }
        if let Some(background) = self.background {
            image.background = background;
        }
    }

    fn set_mode(&self, scene: &mut Scene, facts: &VolumeFacts, overview: Option<&Overview>) {
        let mode = self.mode.map(Mode::from).or((!self.iso.is_empty()).then_some(Mode::Iso));
        let has_surfaces = !self.surface.is_empty() && scene.mode.is_none_or(|mode| mode == Mode::Dvr);
        let is_volume = has_surfaces || ((self.gradient_opacity.is_some() || self.cut_normals) && scene.mode.is_none());
        let mode = mode.or(is_volume.then_some(Mode::Dvr));
        let Some(mode) = mode else { return };
        // Uses the look of the kind, including its lighting, if it has this mode.
        let usual = Scene { image: scene.image.clone(), clip: scene.clip.clone(), ..Scene::default() };
        let usual = usual.complete(facts, overview);
        if scene.mode.is_none() && scene.transfer_function.is_none() && usual.mode == Some(mode) && self.iso.is_empty()
        {
            scene.shading = scene.shading.take().or(usual.shading);
            scene.iso = usual.iso;
            scene.samples_per_pixel = scene.samples_per_pixel.or(usual.samples_per_pixel);
        } else if mode == Mode::Dvr && scene.transfer_function.is_none() && !facts.kind.is_seismic() {
            scene.shading.get_or_insert_with(|| Some(ShadingSpec::default()));
        }
        let keeps_surfaces = mode == Mode::Dvr && scene.mode == Some(Mode::Dvr);
        scene.mode = Some(mode);
        if keeps_surfaces {
            // The surfaces inside the volume stay.
        } else if mode != Mode::Iso {
            scene.iso.clear();
        } else if !self.iso.is_empty() {
            scene.iso = surfaces(&self.iso, looks::default_surface(facts).color);
        } else if scene.iso.is_empty() {
            scene.iso = vec![looks::default_surface(facts)];
        }
    }

    /// Replaces the surfaces inside the volume by the requested ones.
    fn add_surfaces(&self, scene: &mut Scene, facts: &VolumeFacts) -> Result<(), Failure> {
        if !self.iso.is_empty() && scene.mode != Some(Mode::Iso) {
            return Err(Failure::Command(
                "--iso needs mode iso; for surfaces inside the semi-transparent volume (mode dvr), use --surface"
                    .into(),
            ));
        }
        if self.surface.is_empty() {
            return Ok(());
        }
        if scene.mode != Some(Mode::Dvr) {
            return Err(Failure::Command(
                "--surface needs mode dvr: it draws inside the semi-transparent volume; in mode iso, use --iso".into(),
            ));
        }
        let usual = looks::default_surface(facts).color;
        let spec = |request: &SurfaceRequest| IsoSpec {
            value: request.value,
            color: request.color.unwrap_or(usual),
            alpha: request.alpha,
        };
        scene.iso = self.surface.iter().map(spec).collect();
        Ok(())
    }

    /// Camera for a turntable: every picture shows the whole visible region.
    pub fn turning_camera(&self, scene: &Scene, facts: &VolumeFacts, overview: Option<&Overview>) -> CameraSpec {
        let framed = scene.framed(facts, overview);
        self.view(facts, &framed).turning_camera(&framed, [scene.image.width, scene.image.height], upright(facts))
    }

    /// The requested view direction, or the default one.
    fn view(&self, facts: &VolumeFacts, framed: &Framed) -> View {
        let usual = View::facing(facts, framed);
        let request = self
            .camera
            .as_ref()
            .map(|request| View { distance: request.distance, ..View::from(facts, request.direction) });
        View { zoom: self.zoom.unwrap_or(1.0), ..request.unwrap_or(usual) }
    }

    fn set_camera(&self, scene: &mut Scene, facts: &VolumeFacts, overview: Option<&Overview>) {
        if self.shows_panels() {
            return;
        }
        // The framed region depends on the visible region.
        let shown = Scene { camera: None, ..scene.clone() }.complete(facts, overview);
        let framed = shown.framed(facts, overview);
        scene.camera = Some(self.view(facts, &framed).camera(&framed, [scene.image.width, scene.image.height]));
    }

    /// Tests if an option sets the window or the colours of values.
    fn paints(&self) -> bool {
        let has_window = self.window.is_some() || self.clip_percent.is_some();
        has_window || self.colormap.is_some() || self.gamma.is_some()
    }

    /// Applies the options of the transfer function: window, colours, opacities.
    fn repaint(&self, scene: &mut Scene, facts: &VolumeFacts) -> Result<(), Failure> {
        let mode = scene.mode.unwrap_or_default();
        let asked = [
            ("--tf", self.tf.is_some()),
            ("--colormap", self.colormap.is_some()),
            ("--window", self.window.is_some()),
            ("--clip-percent", self.clip_percent.is_some()),
            ("--gamma", self.gamma.is_some()),
            ("--opacity", self.opacity.is_some()),
        ];
        if mode == Mode::Iso
            && let Some((option, _)) = asked.iter().find(|(option, given)| *given && *option != "--opacity")
        {
            return Err(Failure::Command(format!(
                "{option} changes nothing in mode iso: surfaces have their own colours"
            )));
        }
        match (mode, self.opacity) {
            (Mode::Dvr, _) | (_, None) => {}
            (Mode::Iso, Some(factor)) => {
                scene.iso.iter_mut().for_each(|iso| iso.alpha = (iso.alpha * factor).min(1.0));
                return Ok(());
            }
            _ => {
                let message = "--opacity changes nothing in this mode; it needs --mode dvr or iso";
                return Err(Failure::Command(message.into()));
            }
        }
        let Some(TransferFunctionSpec::Points(spec)) = &mut scene.transfer_function else {
            return match asked.iter().find(|(_, given)| *given) {
                Some((option, _)) => Err(Failure::Command(format!(
                    "{option} changes nothing: the scene uses a preset; use --kind instead"
                ))),
                None => Ok(()),
            };
        };
        let window = self.window.map(|window| window.range(facts)).transpose()?;
        let window = window.or(self.clip_percent.map(|percent| ramps::clipped_window(facts, percent)));
        let colors = self.colormap.as_ref().map(ColorMapRequest::colors).transpose()?;
        let paint = Paint { window, colors: colors.as_deref(), gamma: self.gamma };
        if self.paints() {
            for slice in &mut scene.slices {
                if slice.labels {
                    slices::show_numbers(slice, facts);
                }
                slices::repaint(slice, &paint)?;
            }
            let points = paint.applied(&spec.control_points());
            *spec = PointsSpec { unit_distance: spec.unit_distance, ..PointsSpec::of(&points, 1.0) };
        }
        if let Some(factor) = self.opacity {
            spec.points.iter_mut().for_each(|p| p.alpha = times_extinction(p.alpha, factor));
        }
        Ok(())
    }

    fn remove_shading(&self, scene: &mut Scene) -> Result<(), Failure> {
        // Without light, no face of a cut is lit.
        scene.cut_normals = false;
        match scene.shading.replace(None) {
            Some(Some(_)) => Ok(()),
            _ => Err(Failure::Command("--unlit changes nothing: this picture has no lighting".into())),
        }
    }
}

/// Surfaces at these values: the last one is opaque, the others are semi-transparent.
fn surfaces(values: &[f64], usual: [f64; 3]) -> Vec<IsoSpec> {
    let last = values.len().saturating_sub(1);
    let surface = |(i, &value): (usize, &f64)| IsoSpec {
        value,
        color: if i == last { usual } else { CLEAR_COLORS[i % CLEAR_COLORS.len()] },
        alpha: if i == last { 1.0 } else { CLEAR_SURFACE },
    };
    values.iter().enumerate().map(surface).collect()
}

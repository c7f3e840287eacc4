//! The right panel: properties of the volume, look, and render settings.

use eframe::egui::{self, Button, ComboBox, DragValue, Slider, SliderClamping, Ui};
use supervol::{Backend, MAX_ERROR_LIMITS};
use supervol_arguments::flags;
use supervol_format::cast::{narrow, single};
use supervol_format::readable::counted;
use supervol_scene::facts::DataKind;
use supervol_scene::image::GREY_LEVELS;
use supervol_scene::preset::{colormap, looks};
use supervol_scene::scene::{INNER_SURFACE_LIMIT, ISO_LIMIT, IsoSpec, LightSpec, Mode, ShadingSpec};

use super::widgets::{heading, scrolled};
use super::{editor, gradient, transfer};
use crate::edit;
use crate::sections::short;
use crate::state::panels::PanelState;
use crate::viewer::Viewer;
use crate::worker::{Inspect, OpenVolume};

/// Default width of the panel, in points.
const WIDTH: f32 = 300.0;
/// Modes with names and descriptions for the user.
const MODES: [(Mode, &str, &str); 6] = [
    (Mode::Dvr, "Volume", "Emission and absorption (dvr)"),
    (Mode::Iso, "Iso", "Isosurfaces (iso)"),
    (Mode::Mip, "Max", "Maximum value along each ray (mip)"),
    (Mode::Minip, "Min", "Minimum value along each ray (minip)"),
    (Mode::Mean, "Mean", "Mean value along each ray (mean)"),
    (Mode::Slice, "Slices only", "Slices in place, without the volume: a fence, or three planes (slice)"),
];
/// Least and greatest density, relative to the volume's first picture.
const DENSITIES: std::ops::RangeInclusive<f64> = 0.01..=100.0;
/// Least and greatest memory budget, in MiB.
const MEMORY_MIB: std::ops::RangeInclusive<u64> = 64..=65_536;
/// Least and greatest time for interaction, in ms.
const INTERACTION_MS: std::ops::RangeInclusive<u64> = 10..=1000;
/// Devices that can cast rays.
const BACKENDS: [(Backend, &str, &str); 3] = [
    (Backend::Cpu, "CPU", "The processor; it also states the error of each pixel (--backend cpu)"),
    (Backend::Gpu, "GPU", "The graphics device, also a software adapter; the CPU draws the sections (--backend gpu)"),
    (Backend::Auto, "auto", "The GPU if there is a hardware adapter, else the CPU (--backend auto)"),
];
/// Diagnostic displays.
const INSPECTIONS: [(Inspect, &str, &str); 4] = [
    (Inspect::Nothing, "nothing", "The picture alone; unreadable bricks are still outlined in red"),
    (Inspect::Bricks, "bricks", "Outlines of all bricks in memory, coloured by level"),
    (
        Inspect::Errors,
        "errors",
        "Stated error of each pixel in grey levels: black 0.1, blue 0.5, green 2, yellow 16, red 64 (--error-map)",
    ),
    (
        Inspect::Work,
        "work",
        "Work of each pixel's rays: orange for cells crossed, blue for leaps over empty space, on a logarithmic scale up to 1,000 \
         (--work-map). Pictures take several times as long",
    ),
];
/// Possible numbers of samples per pixel.
const SAMPLES: [u32; 4] = [1, 4, 9, 16];

/// Draws the panel.
pub(crate) fn show(viewer: &mut Viewer, ui: &mut Ui) {
    egui::Panel::right("properties").default_size(WIDTH).size_range(220.0..=600.0).show(ui, |ui| {
        scrolled(ui, |ui| {
            let Some(opened) = viewer.opened.clone() else {
                ui.weak("No volume is open.");
                return;
            };
            volume(&opened, ui);
            parts(viewer, &opened, ui);
            look(viewer, &opened, ui);
            match viewer.scene.mode {
                Some(Mode::Iso) => surfaces(viewer, &opened, ui),
                Some(Mode::Dvr) => {
                    colors(viewer, &opened, ui);
                    inner_surfaces(viewer, &opened, ui);
                }
                Some(Mode::Slice) => {
                    ui.weak("Slices have colours of their own: see Slices in the volume, at the left.");
                }
                _ => colors(viewer, &opened, ui),
            }
            light(viewer, ui);
            quality(viewer, ui);
        });
    });
}

fn volume(opened: &OpenVolume, ui: &mut Ui) {
    heading(ui, "Volume");
    let (facts, manifest) = (opened.facts(), opened.container().manifest());
    let [x, y, z] = facts.dims.0;
    let name = opened.source.file_name().unwrap_or_default().to_string_lossy();
    let read = &manifest.source.name;
    // The name includes the chosen channel or time point of the file.
    let name = if read.starts_with(&*name) { read.clone() } else { name.into_owned() };
    ui.label(name).on_hover_text(opened.path.display().to_string());
    let unit = &manifest.unit;
    ui.label(format!("{x} x {y} x {z} voxels, {}", opened.container().descriptor().voxel_type.name()));
    ui.label(format!("values {} to {} {unit}", short(facts.value_range.min), short(facts.value_range.max)));
    for words in extent(opened) {
        ui.label(words);
    }
    if !manifest.notes.is_empty() {
        let title = counted(manifest.notes.len() as u64, "note");
        egui::CollapsingHeader::new(title).id_salt("notes").default_open(true).show(ui, |ui| {
            for note in &manifest.notes {
                ui.small(flags::with_flags(note));
            }
        });
    }
}

/// Draws the channel and time point of a source file. Their numbers are known only after reading: an invalid choice is
/// refused with the valid range.
fn parts(viewer: &mut Viewer, opened: &OpenVolume, ui: &mut Ui) {
    if opened.source == opened.path || opened.preview_of.is_some() {
        return;
    }
    let selection = &opened.reading.options.selection;
    let mut chosen = [selection.channel, selection.frame];
    let names = [
        (
            "Channel",
            "Channel, colour or component of the file, starting at 0 (--channel); -: all colours, or the first channel",
        ),
        ("Time point", "Time point of the file, starting at 0 (--frame); -: the first"),
    ];
    // Disabled while another volume is opened.
    ui.add_enabled_ui(viewer.busy.is_none(), |ui| {
        ui.horizontal(|ui| {
            for (part, (name, words)) in chosen.iter_mut().zip(names) {
                *part = part_number(*part, (name, words), ui);
            }
        });
    });
    if chosen != [selection.channel, selection.frame] && viewer.busy.is_none() {
        viewer.open_part(chosen[0], chosen[1]);
    }
}

/// Draws a number field with buttons for next and previous; negative means no choice. It cannot be dragged, because
/// each value opens a volume.
fn part_number(part: Option<u64>, (name, words): (&str, &str), ui: &mut Ui) -> Option<u64> {
    let mut number = part.map_or(-1, |number| narrow::<i64>(number.min(u64::from(u32::MAX))));
    let pressed = |ui: &mut Ui, label: &str, which: &str, is_possible: bool| {
        let button = ui.add_enabled(is_possible, Button::new(label).small()).on_hover_text(words);
        button.accessible_name(format!("{name}, {which}")).clicked()
    };
    ui.label(name);
    if pressed(ui, "<", "previous", number >= 0) {
        number -= 1;
    }
    let shown = |number: f64, _| if number < 0.0 { "-".into() } else { number.to_string() };
    let understood = |text: &str| if text.trim() == "-" { Some(-1.0) } else { text.trim().parse().ok() };
    let typed = DragValue::new(&mut number).range(-1..=i64::from(u32::MAX)).speed(0.0).update_while_editing(false);
    let response = ui.add(typed.custom_formatter(shown).custom_parser(understood)).on_hover_text(words);
    response.accessible_name(name);
    if pressed(ui, ">", "next", true) {
        number += 1;
    }
    u64::try_from(number).ok()
}

/// Lines and samples of a survey; for other volumes, the voxel spacing.
fn extent(opened: &OpenVolume) -> Vec<String> {
    let axes = &opened.container().manifest().axes;
    let Some(survey) = &opened.survey else {
        let [x, y, z] = opened.container().stored_geometry().spacing.map(short);
        return vec![format!("voxels {x} x {y} x {z} {}", axes[0].unit).trim_end().into()];
    };
    let scales = survey.scales();
    let last = |axis: usize| scales[axis][0] + scales[axis][1] * (opened.facts().dims.0[axis] as f64 - 1.0);
    let range = |axis: usize| format!("{} {} to {}", axes[axis].name, short(scales[axis][0]), short(last(axis)));
    vec![format!("{}, {}", range(1), range(0)), format!("{} {}", range(2), axes[2].unit).trim_end().into()]
}

fn look(viewer: &mut Viewer, opened: &OpenVolume, ui: &mut Ui) {
    heading(ui, "Look");
    ui.horizontal(|ui| {
        ui.label("Kind");
        let box_ = ComboBox::from_id_salt("preset").selected_text(opened.facts().kind.name()).show_ui(ui, |ui| {
            DataKind::ALL
                .into_iter()
                .find(|kind| ui.selectable_label(*kind == opened.facts().kind, kind.name()).clicked())
        });
        box_.response
            .on_hover_text("Default picture of a kind of data; `info` prints the recognised kind")
            .accessible_name("Kind");
        if let Some(kind) = box_.inner.flatten() {
            viewer.scene = edit::with_kind(&viewer.scene, opened, kind);
            viewer.panel_state = PanelState::of(&viewer.scene);
        }
    });
    ui.horizontal_wrapped(|ui| {
        for (mode, name, words) in MODES {
            let is_shown = viewer.scene.mode == Some(mode);
            if ui.selectable_label(is_shown, name).on_hover_text(words).clicked() && !is_shown {
                viewer.set_mode(mode);
            }
        }
    });
    ui.horizontal(|ui| {
        ui.label("Background");
        let mut color = viewer.scene.image.background.map(single);
        if ui.color_edit_button_rgb(&mut color).accessible_name("Background").changed() {
            viewer.scene.image.background = color.map(f64::from);
        }
        ui.label("Rays a pixel");
        let samples = viewer.scene.samples_per_pixel.unwrap_or(1);
        let box_ = ComboBox::from_id_salt("samples").width(40.0).selected_text(samples.to_string()).show_ui(ui, |ui| {
            SAMPLES.into_iter().find(|n| ui.selectable_label(*n == samples, n.to_string()).clicked())
        });
        box_.response
            .accessible_name("Rays a pixel")
            .on_hover_text("Number of rays of each pixel; fine lines need more");
        if let Some(samples) = box_.inner.flatten() {
            viewer.scene.samples_per_pixel = Some(samples);
        }
    });
}

fn colors(viewer: &mut Viewer, opened: &OpenVolume, ui: &mut Ui) {
    heading(ui, "Colours and opacity");
    let facts = opened.facts();
    editor::show(viewer, opened, ui);
    transfer::controls(viewer, ui);
    ui.horizontal(|ui| {
        ui.label("Colours");
        let box_ = ComboBox::from_id_salt("colormap")
            .selected_text("choose")
            .show_ui(ui, |ui| colormap::NAMES.into_iter().find(|name| ui.selectable_label(false, *name).clicked()));
        box_.response.accessible_name("Colour map").on_hover_text("Applies a colour map; opacities stay");
        if let Some(name) = box_.inner.flatten() {
            edit::set_colors(&mut viewer.scene, name);
            viewer.panel_state.chosen = None;
        }
    });
    if let Some([low, high]) = edit::window(&viewer.scene) {
        let speed = (facts.central_range.width() / 500.0).max(f64::MIN_POSITIVE);
        let mut window = [low, high];
        ui.horizontal(|ui| {
            ui.label("Window");
            for (end, name) in window.iter_mut().zip(["Window, least value", "Window, greatest value"]) {
                ui.add(DragValue::new(end).speed(speed).max_decimals(4)).on_hover_text(name).accessible_name(name);
            }
        });
        if window != [low, high] {
            edit::set_window(&mut viewer.scene, window);
        }
    }
    ui.horizontal(|ui| {
        ui.label("Clip");
        let percent = &mut viewer.panel_state.clip_percent;
        let drag = DragValue::new(percent)
            .speed(0.05)
            .range(0.0..=49.0)
            .clamp_existing_to_range(false)
            .suffix(" %")
            .max_decimals(2);
        let words = "Percentage of the voxels outside the window, at each end";
        if ui.add(drag).on_hover_text(words).accessible_name("Clip, percent").changed() {
            let percent = *percent;
            edit::clip_percent(&mut viewer.scene, facts, percent);
        }
    });
    if viewer.scene.mode == Some(Mode::Dvr) {
        density(viewer, ui);
        gradient::show(viewer, opened, ui);
    }
}

/// Draws the density: the unit distance of the volume's first picture divided by the present one.
fn density(viewer: &mut Viewer, ui: &mut Ui) {
    let Some(first) = viewer.panel_state.unit_distance else { return };
    let Some(spec) = edit::points_mut(&mut viewer.scene) else { return };
    let Some(unit) = spec.unit_distance.filter(|unit| *unit > 0.0) else { return };
    let mut density = first / unit;
    ui.horizontal(|ui| {
        ui.label("Density");
        let slider = Slider::new(&mut density, DENSITIES)
            .clamping(SliderClamping::Edits)
            .logarithmic(true)
            .max_decimals(3)
            .suffix(" x");
        let words = "Multiplies the extinction (1 = as in the first picture)";
        if ui.add(slider).on_hover_text(words).accessible_name("Density").changed() {
            spec.unit_distance = Some(first / density);
        }
    });
}

/// Draws the iso surfaces of mode `iso`; at least one stays.
fn surfaces(viewer: &mut Viewer, opened: &OpenVolume, ui: &mut Ui) {
    heading(ui, "Surfaces");
    let is_lone = viewer.scene.iso.len() == 1;
    list_of_surfaces(&mut viewer.scene.iso, opened, !is_lone, ui);
    if ui.add_enabled(viewer.scene.iso.len() < ISO_LIMIT, egui::Button::new("Add a surface")).clicked() {
        viewer.scene.iso.push(looks::default_surface(opened.facts()));
    }
}

/// Draws the iso surfaces inside the semi-transparent volume.
fn inner_surfaces(viewer: &mut Viewer, opened: &OpenVolume, ui: &mut Ui) {
    heading(ui, "Surfaces in the volume");
    list_of_surfaces(&mut viewer.scene.iso, opened, true, ui);
    let has_room = viewer.scene.iso.len() < INNER_SURFACE_LIMIT;
    let words = format!("Adds an isosurface inside the volume; at most {INNER_SURFACE_LIMIT} (--surface)");
    let button = ui.add_enabled(has_room, egui::Button::new("+ surface")).on_hover_text(words);
    if button.clicked() {
        edit::add_inner_surface(&mut viewer.scene, opened.facts());
    }
}

/// Draws colour, value and opacity of each surface, with a button to remove it if `may_go` is set.
fn list_of_surfaces(surfaces: &mut Vec<IsoSpec>, opened: &OpenVolume, may_go: bool, ui: &mut Ui) {
    let range = opened.facts().central_range;
    let words = format!("Value of the surface {}", opened.container().manifest().unit);
    let mut removed = None;
    for (i, iso) in surfaces.iter_mut().enumerate() {
        ui.push_id(i, |ui| {
            ui.horizontal(|ui| {
                let mut color = iso.color.map(single);
                if ui.color_edit_button_rgb(&mut color).accessible_name("Colour of the surface").changed() {
                    iso.color = color.map(f64::from);
                }
                ui.spacing_mut().slider_width = (ui.available_width() - 110.0).max(40.0);
                let slider = Slider::new(&mut iso.value, range.min..=range.max).clamping(SliderClamping::Edits);
                ui.add(slider.max_decimals(4)).on_hover_text(words.trim_end()).accessible_name("Value of the surface");
                if may_go && ui.small_button("x").on_hover_text("Removes this surface").clicked() {
                    removed = Some(i);
                }
            });
            ui.add(Slider::new(&mut iso.alpha, 0.0..=1.0).clamping(SliderClamping::Edits).text("opacity"))
                .on_hover_text("Fraction of the light from behind that the surface absorbs, 0 to 1")
                .accessible_name("Opacity of the surface");
        });
    }
    if let Some(i) = removed {
        surfaces.remove(i);
    }
}

fn light(viewer: &mut Viewer, ui: &mut Ui) {
    heading(ui, "Light");
    if !matches!(viewer.scene.mode, Some(Mode::Dvr | Mode::Iso)) {
        ui.weak("Projections and slices have no lighting.");
        return;
    }
    let mut is_lit = matches!(viewer.scene.shading, Some(Some(_)));
    if ui.checkbox(&mut is_lit, "Lit").on_hover_text("Lights surfaces and gradients").changed() {
        viewer.scene.shading = Some(is_lit.then(ShadingSpec::default));
    }
    let Some(Some(shading)) = &mut viewer.scene.shading else { return };
    let factors = [
        (&mut shading.ambient, "ambient", 0.0..=1.0),
        (&mut shading.diffuse, "diffuse", 0.0..=1.5),
        (&mut shading.specular, "highlights", 0.0..=1.5),
        (&mut shading.shininess, "shininess", 1.0..=200.0),
    ];
    for (factor, name, range) in factors {
        ui.add(Slider::new(factor, range).clamping(SliderClamping::Edits).text(name).max_decimals(2))
            .accessible_name(name);
    }
    let mut is_head_light = shading.lights.is_none();
    let words = "The light moves with the camera; otherwise it is fixed in the world";
    if ui.checkbox(&mut is_head_light, "From the camera").on_hover_text(words).changed() && is_head_light {
        shading.lights = None;
    }
    if is_head_light {
        return;
    }
    let Some(camera) = &viewer.scene.camera else { return };
    let angles = &mut viewer.panel_state.light;
    let mut changed = shading.lights.is_none();
    for (angle, name) in angles.iter_mut().zip(["from the right", "from above"]) {
        let slider =
            Slider::new(angle, -90.0..=90.0).clamping(SliderClamping::Edits).suffix("°").text(name).max_decimals(0);
        changed |=
            ui.add(slider).on_hover_text("Degrees, relative to the present camera").accessible_name(name).changed();
    }
    if changed {
        shading.lights = Some(vec![LightSpec { direction: edit::light_from(camera, *angles), intensity: 1.0 }]);
    }
}

fn quality(viewer: &mut Viewer, ui: &mut Ui) {
    heading(ui, "Quality and memory");
    let settings = &mut viewer.settings;
    let limits = MAX_ERROR_LIMITS.map(|share| share * GREY_LEVELS);
    let mut levels = settings.max_error * GREY_LEVELS;
    let slider = Slider::new(&mut levels, limits[0]..=limits[1])
        .clamping(SliderClamping::Edits)
        .logarithmic(true)
        .max_decimals(2)
        .text("error");
    let words = "Largest allowed error of a pixel, in grey levels of 255 (--max-error)";
    let response = ui.add(slider).on_hover_text(words).accessible_name("Error target");
    if response.changed() {
        settings.max_error = (levels / GREY_LEVELS).clamp(MAX_ERROR_LIMITS[0], MAX_ERROR_LIMITS[1]);
    }
    let mut mebibytes = settings.host_memory_bytes >> 20;
    ui.horizontal(|ui| {
        ui.label("Memory");
        let drag =
            DragValue::new(&mut mebibytes).range(MEMORY_MIB).clamp_existing_to_range(false).suffix(" MiB").speed(8.0);
        let words = "Memory limit for bricks, rays and pictures; the window itself needs more (--host-memory)";
        if ui.add(drag).on_hover_text(words).accessible_name("Memory").changed() {
            settings.host_memory_bytes = mebibytes << 20;
        }
    });
    ui.horizontal(|ui| {
        ui.label("While moving");
        let drag = DragValue::new(&mut settings.interaction_ms)
            .range(INTERACTION_MS)
            .clamp_existing_to_range(false)
            .suffix(" ms");
        let words = "Deadline for the first picture after a change; it may be coarse (--time-budget)";
        ui.add(drag).on_hover_text(words).accessible_name("Time for interaction");
    });
    ui.horizontal_wrapped(|ui| {
        ui.label("Drawn by");
        for (backend, name, words) in BACKENDS {
            ui.selectable_value(&mut settings.backend, backend, name).on_hover_text(words);
        }
    });
    ui.horizontal_wrapped(|ui| {
        ui.label("Inspect");
        for (inspect, name, words) in INSPECTIONS {
            ui.selectable_value(&mut settings.inspect, inspect, name).on_hover_text(words);
        }
    });
}

//! Commands and their key bindings: one list, which keys are matched against and which the help window shows.

use eframe::egui::{self, Key, KeyboardShortcut, Modifiers};
use supervol_scene::preset::view::Direction;

/// A command that a key, a button or both trigger.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Command {
    /// Show the help window of keys.
    Help,
    /// Show the dialog to open a file.
    Open,
    /// Show the dialog to save the scene.
    SaveScene,
    /// Show the dialog to export a picture.
    Export,
    /// Show the dialog to make an animation.
    Animate,
    /// Copy the command line of this picture to the clipboard.
    CopyCommand,
    /// Undo the last edit.
    Undo,
    /// Redo the last undone edit.
    Redo,
    /// Set a camera that frames the visible region from the default direction.
    DefaultView,
    /// Set a camera that frames the visible region from this direction.
    ViewFrom(Direction),
    /// Switch between perspective and orthographic projection.
    Projection,
    /// Turn the camera by steps: to the right, up.
    Turn([i8; 2]),
    /// Move the picture by steps: to the right, up.
    Move([i8; 2]),
    /// Move the camera nearer by steps; negative: away.
    Nearer(i8),
    /// Move camera and target forward by steps; negative: back.
    Fly(i8),
    /// Show or hide the panels with controls.
    Panels,
    /// Show or hide the panels with sections.
    Sections,
    /// Show or hide the handles in the picture.
    Handles,
    /// Start or stop the cine.
    Cine,
    /// Switch full screen on or off.
    FullScreen,
}

/// A command with its keys and its description.
#[derive(Debug)]
pub struct Binding {
    /// The command.
    pub command: Command,
    /// Keys; buttons show the first one.
    pub keys: &'static [KeyboardShortcut],
    /// Description for the user.
    pub words: &'static str,
}

const fn plain(key: Key) -> KeyboardShortcut {
    KeyboardShortcut::new(Modifiers::NONE, key)
}

const fn with_shift(key: Key) -> KeyboardShortcut {
    KeyboardShortcut::new(Modifiers::SHIFT, key)
}

const fn with_command(key: Key) -> KeyboardShortcut {
    KeyboardShortcut::new(Modifiers::COMMAND, key)
}

const fn with_command_and_shift(key: Key) -> KeyboardShortcut {
    KeyboardShortcut::new(Modifiers::COMMAND.plus(Modifiers::SHIFT), key)
}

const fn binding(command: Command, keys: &'static [KeyboardShortcut], words: &'static str) -> Binding {
    Binding { command, keys, words }
}

/// All bindings. Those with more modifiers come first, because a shortcut matches whenever its own modifiers are
/// pressed.
pub const BINDINGS: &[Binding] = &[
    binding(Command::Redo, &[with_command_and_shift(Key::Z), with_command(Key::Y)], "Redo"),
    binding(Command::CopyCommand, &[with_command_and_shift(Key::C)], "Copy the command that draws this picture"),
    binding(Command::Undo, &[with_command(Key::Z)], "Undo"),
    binding(Command::Open, &[with_command(Key::O)], "Open a file"),
    binding(Command::SaveScene, &[with_command(Key::S)], "Save the scene"),
    binding(Command::Export, &[with_command(Key::E)], "Export a picture"),
    binding(Command::Animate, &[with_command(Key::M)], "Make an animation"),
    binding(Command::Move([-1, 0]), &[with_shift(Key::ArrowLeft)], "Move the picture to the left"),
    binding(Command::Move([1, 0]), &[with_shift(Key::ArrowRight)], "Move the picture to the right"),
    binding(Command::Move([0, 1]), &[with_shift(Key::ArrowUp)], "Move the picture up"),
    binding(Command::Move([0, -1]), &[with_shift(Key::ArrowDown)], "Move the picture down"),
    binding(Command::Turn([-1, 0]), &[plain(Key::ArrowLeft)], "Turn left"),
    binding(Command::Turn([1, 0]), &[plain(Key::ArrowRight)], "Turn right"),
    binding(Command::Turn([0, 1]), &[plain(Key::ArrowUp)], "Turn up"),
    binding(Command::Turn([0, -1]), &[plain(Key::ArrowDown)], "Turn down"),
    binding(Command::Nearer(1), &[plain(Key::Plus), plain(Key::Equals)], "Move nearer"),
    binding(Command::Nearer(-1), &[plain(Key::Minus)], "Move away"),
    binding(Command::Fly(1), &[plain(Key::W)], "Fly forward"),
    binding(Command::Fly(-1), &[plain(Key::S)], "Fly back"),
    binding(Command::DefaultView, &[plain(Key::Num0), plain(Key::Home)], "Default view"),
    binding(Command::ViewFrom(Direction::Front), &[plain(Key::Num1)], "From the front"),
    binding(Command::ViewFrom(Direction::Back), &[plain(Key::Num2)], "From behind"),
    binding(Command::ViewFrom(Direction::Left), &[plain(Key::Num3)], "From the left"),
    binding(Command::ViewFrom(Direction::Right), &[plain(Key::Num4)], "From the right"),
    binding(Command::ViewFrom(Direction::Top), &[plain(Key::Num5)], "From above"),
    binding(Command::ViewFrom(Direction::Bottom), &[plain(Key::Num6)], "From below"),
    binding(Command::Projection, &[plain(Key::P)], "Switch between perspective and parallel rays"),
    binding(Command::Sections, &[plain(Key::T)], "Show or hide three sections beside the picture"),
    binding(Command::Handles, &[plain(Key::B)], "Show or hide the handles of crop box, clip planes, slices and solids"),
    binding(Command::Cine, &[plain(Key::C)], "Start or stop the cine: one slice after the other"),
    binding(Command::Panels, &[plain(Key::H)], "Show or hide the panels"),
    binding(Command::FullScreen, &[plain(Key::F11)], "Full screen"),
    binding(Command::Help, &[plain(Key::Questionmark), plain(Key::F1), with_shift(Key::Slash)], "Keys and mouse"),
];

/// Mouse actions and their descriptions.
pub const MOUSE: &[(&str, &str)] = &[
    ("Drag", "Turn"),
    ("Right or middle drag, or Shift and drag", "Move the picture"),
    ("Wheel, two fingers, pinch", "Move nearer or away, towards the mouse"),
    ("In a section: click or drag", "Move the cursor: all sections pass through it"),
    ("In a section: wheel; with Ctrl", "Move the section; zoom"),
    ("In a section: Ctrl and drag", "Window: to the right wider, up brighter (a lower level)"),
    ("In a section: right drag; double click", "Move the picture; show all of it"),
    ("In a section: right click", "Save the scene of the section, or export the section"),
    ("Click in the picture, with sections", "Move the cursor to the visible point there"),
    ("Drag a handle", "Move a face of the crop box, a clip plane, a slice, a solid"),
    ("Alt and wheel", "Move the slice; of several slices, the selected one"),
    ("Double click", "Centre the point under the mouse, and move nearer"),
    ("Drop a file on the window", "Open it"),
];

/// The first key of a command as text.
#[must_use]
pub fn keys_of(ctx: &egui::Context, command: Command) -> String {
    let binding = BINDINGS.iter().find(|b| b.command == command);
    binding.and_then(|b| b.keys.first()).map_or(String::new(), |key| words_of(ctx, key))
}

/// A key combination as text, with the signs on keyboards.
#[must_use]
pub fn words_of(ctx: &egui::Context, keys: &KeyboardShortcut) -> String {
    let sign = match keys.logical_key {
        Key::Questionmark => "?",
        Key::Slash => "/",
        Key::Plus => "+",
        Key::Minus => "-",
        Key::Equals => "=",
        _ => return ctx.format_shortcut(keys),
    };
    let named = ctx.format_shortcut(keys);
    named.strip_suffix(keys.logical_key.name()).map_or_else(|| named.clone(), |before| format!("{before}{sign}"))
}

/// Commands whose keys have been pressed since the last frame. Empty while a text field has the focus.
pub fn pressed(ctx: &egui::Context) -> Vec<Command> {
    if ctx.egui_wants_keyboard_input() {
        return Vec::new();
    }
    ctx.input_mut(|input| {
        let is_pressed = |binding: &&Binding| binding.keys.iter().any(|key| input.consume_shortcut(key));
        BINDINGS.iter().filter(is_pressed).map(|binding| binding.command).collect()
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn keys_are_named_as_on_keyboards() {
        let ctx = egui::Context::default();
        let named = |key| words_of(&ctx, &key);
        assert_eq!(
            [named(plain(Key::Questionmark)), named(plain(Key::Minus)), named(plain(Key::F1))],
            ["?", "-", "F1"]
        );
        let of_help = BINDINGS.iter().find(|b| b.command == Command::Help).expect("help has keys");
        assert_eq!(of_help.keys.len(), 3);
        assert!(named(with_shift(Key::Slash)).ends_with('/') && named(with_shift(Key::Slash)).len() > 1);
    }

    /// A shortcut with fewer modifiers would take the keys of a later one with more.
    #[test]
    fn no_binding_hides_another() {
        let all: Vec<_> = BINDINGS.iter().flat_map(|b| b.keys.iter().map(move |key| (b.words, key))).collect();
        for (i, (words, key)) in all.iter().enumerate() {
            for (later_words, later) in &all[i + 1..] {
                let hides = later.logical_key == key.logical_key && later.modifiers.matches_logically(key.modifiers);
                assert!(!hides, "{words} hides {later_words}");
            }
        }
    }
}

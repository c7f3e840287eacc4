// The transfer function in pieces, and look-ups in them. Twin of engines/packets/lookup.rs; engines/gpu/piece_table.rs writes the
// table. Channels are red, green, blue (each times extinction), extinction; extinction is per world length.

// Position of a value: its piece, and its distance from the piece's anchor.
struct Place {
    piece: u32,
    y: f32,
}

// The channels in a piece: coefficients of quadratics.
struct Quadratics {
    value: vec4<f32>,
    half_slope: vec4<f32>,
    third_bend: vec4<f32>,
}

// The channels at a place.
struct Channels {
    // Antiderivatives from the anchor on.
    rest: vec4<f32>,
    value: vec4<f32>,
    third_bend: vec4<f32>,
    // Greatest slope of a channel, and of extinction less an emission.
    slope: f32,
}

// Texel `number` of the table.
fn table_texel(number: u32) -> vec4<f32> {
    return bitcast<vec4<f32>>(light_texel_at(vec2<u32>(number % TABLE_WIDTH, number / TABLE_WIDTH)));
}

// Texel `i` of a piece.
fn piece_texel(piece: u32, i: u32) -> vec4<f32> {
    return table_texel(config.first_piece + PIECE_TEXELS * piece + i);
}

// The piece of a value: the last whose knot is not greater. Every texel of the search holds three knots, which divide the pieces
// that are left by four.
fn piece_of(value: f32) -> u32 {
    var piece = 0u;
    var step = config.search_step;
    var first = 0u;
    loop {
        let knots = table_texel(first + piece / (4u * step)).xyz;
        piece += step * dot(vec3<u32>(knots <= vec3<f32>(value)), vec3<u32>(1u));
        first = 4u * first + 1u;
        step /= 4u;
        if (step == 0u) {
            break;
        }
    }
    return piece;
}

// Anchor, next knot, changes of slope per value, variation of colour per value.
fn extent_of(piece: u32) -> vec4<f32> {
    return piece_texel(piece, 0u);
}

fn place_in(piece: u32, value: f32) -> Place {
    return Place(piece, value - extent_of(piece).x);
}

fn quadratics(piece: u32) -> Quadratics {
    return Quadratics(piece_texel(piece, 1u), piece_texel(piece, 2u), piece_texel(piece, 3u));
}

// All channels at a distance from the piece's anchor.
fn channels_at(of_piece: Quadratics, y: f32) -> Channels {
    let rest = y * (of_piece.value + y * (of_piece.half_slope + y * of_piece.third_bend));
    let half_there = of_piece.half_slope + (3.0 * y) * of_piece.third_bend;
    let value = of_piece.value + y * (of_piece.half_slope + half_there);
    let slopes = 2.0 * half_there;
    return Channels(rest, value, of_piece.third_bend, greatest_channel(slopes));
}

// Greatest of a quantity that every channel has, and of the same of extinction less emission.
fn greatest_channel(channels: vec4<f32>) -> f32 {
    let of_each = max(abs(channels.rgb), abs(channels.www - channels.rgb));
    return max(greatest_of(of_each), abs(channels.w));
}

// Antiderivatives at the anchor.
fn starts(piece: u32) -> vec4<f32> {
    return piece_texel(piece, 4u);
}

// Sums up to the anchor: heights of steps, changes of slope, those at knots alone, variation of colour.
fn sums_of(piece: u32) -> vec4<f32> {
    return piece_texel(piece, 5u);
}

// Number of the stretch between two control points, its greatest change of slope per value, sum of its changes of curvature.
fn stretch_of(piece: u32) -> vec4<f32> {
    return piece_texel(piece, 6u);
}

// The next control point above and the last below, each with its greatest change of slope.
fn kinks_beside(piece: u32) -> vec4<f32> {
    return piece_texel(piece, 7u);
}

// Changes of slope at the control point above.
fn changes_above(piece: u32) -> vec4<f32> {
    return piece_texel(piece, 8u);
}

// Changes of slope at the control point below.
fn changes_below(piece: u32) -> vec4<f32> {
    return piece_texel(piece, 9u);
}

//! Positions of traces as a linear function of their line numbers.

/// Sums of a least-squares fit of positions to line numbers: `point = a + b * inline + c * crossline`, by the normal
/// equations of Gauss. One pass, constant memory; numbers are taken relative to the first trace's, which keeps the
/// sums accurate for map coordinates of millions of metres. Points (0, 0) are left out: they are what headers without
/// a position hold.
#[derive(Debug, Default, Clone)]
pub(crate) struct PositionFit {
    /// Line numbers and point of the first trace with a position.
    origin: Option<([i64; 2], [f64; 2])>,
    count: f64,
    lines: [f64; 2],
    /// Sums of inline * inline, inline * crossline, crossline * crossline.
    line_products: [f64; 3],
    points: [f64; 2],
    /// Sum of the square of each component of the points.
    squares: [f64; 2],
    /// `[point component][line axis]`.
    mixed: [[f64; 2]; 2],
    /// Largest absolute coordinate.
    pub(super) largest: f64,
}

/// Means and slopes of a fit, relative to its origin.
struct Solution {
    mean_lines: [f64; 2],
    mean_point: [f64; 2],
    /// `[point component][line axis]`.
    slopes: [[f64; 2]; 2],
    /// Root mean square distance of the points from the fit.
    residual: f64,
}

impl PositionFit {
    /// Adds one trace.
    pub(crate) fn add(&mut self, position: [i32; 2], point: [f64; 2]) {
        if point == [0.0; 2] {
            return;
        }
        let position = position.map(i64::from);
        let (first, first_point) = *self.origin.get_or_insert((position, point));
        self.largest = self.largest.max(point[0].abs()).max(point[1].abs());
        let [i, j] = [0, 1].map(|a| (position[a] - first[a]) as f64);
        self.count += 1.0;
        self.lines[0] += i;
        self.lines[1] += j;
        self.line_products[0] += i * i;
        self.line_products[1] += i * j;
        self.line_products[2] += j * j;
        for component in [0, 1] {
            let p = point[component] - first_point[component];
            self.points[component] += p;
            self.squares[component] += p * p;
            self.mixed[component][0] += p * i;
            self.mixed[component][1] += p * j;
        }
    }

    /// Whether any trace has a position.
    pub(super) fn any(&self) -> bool {
        self.origin.is_some()
    }

    /// The fit, or `None` if the traces do not determine it.
    fn solve(&self) -> Option<Solution> {
        let n = self.count;
        let mean_lines = self.lines.map(|s| s / n);
        let mean_point = self.points.map(|s| s / n);
        let ii = self.line_products[0] - n * mean_lines[0] * mean_lines[0];
        let ij = self.line_products[1] - n * mean_lines[0] * mean_lines[1];
        let jj = self.line_products[2] - n * mean_lines[1] * mean_lines[1];
        let determinant = ii * jj - ij * ij;
        let (mut slopes, mut error) = ([[0.0; 2]; 2], 0.0);
        for component in [0, 1] {
            let mean = mean_point[component];
            let [pi, pj] = [0, 1].map(|a| self.mixed[component][a] - n * mean * mean_lines[a]);
            let slope = match (ii > 0.0, jj > 0.0) {
                (true, true) if determinant > 1e-9 * ii * jj => {
                    [(pi * jj - pj * ij) / determinant, (pj * ii - pi * ij) / determinant]
                }
                (true, true) => return None,
                (true, false) => [pi / ii, 0.0],
                (false, true) => [0.0, pj / jj],
                (false, false) => [0.0, 0.0],
            };
            error += self.squares[component] - n * mean * mean - slope[0] * pi - slope[1] * pj;
            slopes[component] = slope;
        }
        Some(Solution { mean_lines, mean_point, slopes, residual: (error.max(0.0) / n).sqrt() })
    }

    /// The fitted position of a crossing and the fit's residual, or `None` if the traces do not determine it.
    pub(crate) fn at(&self, inline: i64, crossline: i64) -> Option<([f64; 2], f64)> {
        let (first, first_point) = self.origin?;
        let fit = self.solve()?;
        let offset = [inline - first[0], crossline - first[1]];
        let from_mean = [0, 1].map(|a| offset[a] as f64 - fit.mean_lines[a]);
        let point = [0, 1].map(|c| {
            let [along_inline, along_crossline] = fit.slopes[c];
            first_point[c] + fit.mean_point[c] + along_inline * from_mean[0] + along_crossline * from_mean[1]
        });
        Some((point, fit.residual))
    }
}

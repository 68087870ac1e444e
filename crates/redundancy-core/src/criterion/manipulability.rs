//! Manipulability `w = det(J J^T)` of a task, or its root, to be maximised.
//!
//! With `A = J J^T` and indices for derivatives, Jacobi's formula gives `w_k = tr(adj(A) A_k)`. The adjugate is
//! defined where A is singular too, and so are the gradient and the Hessian. With any W that makes `W A W^T` diagonal,
//! `B_k = W A_k W^T` and `c_i`, `c_ij` the products of its diagonal without entry i, without entries i and j,
//! both divided by `det(W)^2`:
//!
//! ```text
//! adj(A) = sum_i c_i W_i^T W_i
//! w_kl   = tr(adj(A) A_kl) + sum_{i != j} c_ij (B_k,ii B_l,jj - B_k,ij B_l,ij)
//! ```
//!
//! W is the inverse Cholesky factor (all products are then w), and the eigenvectors where a pivot vanishes.
//! The derivatives of J's columns, contracted with `adj(A) J`, are sums over the joints before, between and after k
//! and l (see [`Kinematics::jacobian_second_derivative`]), so the gradient costs O(n) beyond A.
//!
//! For `pointing` the two directions across the tool axis are carried along by the tool: another choice turns
//! the rows of J only, which w does not see. For `pose_rpy`, `w = w_pose / cos^2 theta`.
//! The root is not differentiable where it is zero; gradient and Hessian are zero there.

use nalgebra::{DMatrix, Matrix3, Matrix6, Vector3};

use super::{Criterion, Sense};
use crate::chain::Chain;
use crate::error::{Error, Result};
use crate::kinematics::{Kinematics, Scratch, Task, TaskKind};
use crate::tolerance::{MANIPULABILITY_PIVOT, RPY_COSINE};

/// What is measured.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Measure {
    /// `det(J J^T)`: smooth everywhere.
    #[default]
    Det,
    /// `sqrt(det(J J^T))`, the volume of the velocity ellipsoid up to a constant.
    Sqrt,
}

impl Measure {
    /// Every measure.
    pub const ALL: [Self; 2] = [Self::Det, Self::Sqrt];

    /// The measure as a word.
    pub fn as_str(self) -> &'static str {
        match self {
            Self::Det => "det",
            Self::Sqrt => "sqrt",
        }
    }

    /// The measure with this name.
    ///
    /// # Errors
    /// An unknown name; the message lists the known ones.
    pub fn from_name(name: &str) -> Result<Self> {
        Self::ALL.into_iter().find(|measure| measure.as_str() == name).ok_or_else(|| {
            let valid = Self::ALL.iter().map(|measure| measure.as_str().to_owned()).collect();
            Error::UnknownName { kind: "measure", name: name.into(), valid }
        })
    }
}

/// Manipulability of a task, to be maximised. Zero for tasks with more coordinates than the arm has joints.
///
/// ```
/// use redundancy_core::{chain::catalog, criterion::{Criterion, Manipulability}, kinematics::Task};
/// let arm = catalog::load("planar3r")?;
/// let h = Manipulability::new(&arm, Task::PLANAR);
/// assert!(h.value(&[0.0; 3]).abs() < 1e-12); // stretched
/// assert!(h.value(&[0.0, 1.0, 1.0]) > 1.0);
/// # Ok::<(), redundancy_core::Error>(())
/// ```
#[derive(Debug, Clone)]
pub struct Manipulability {
    chain: Chain,
    task: Task,
    measure: Measure,
}

impl Manipulability {
    /// `det(J J^T)`.
    pub fn new(chain: &Chain, task: Task) -> Self {
        Self::with_measure(chain, task, Measure::Det)
    }

    /// With the measure of choice.
    pub fn with_measure(chain: &Chain, task: Task, measure: Measure) -> Self {
        Self { chain: chain.clone(), task, measure }
    }

    /// The task whose coordinates count.
    pub fn task(&self) -> Task {
        self.task
    }

    /// Its value where the kinematics are known.
    pub fn value_at(&self, kinematics: &Kinematics<'_>) -> f64 {
        let factors = Factors::new(&Columns::new(self.task, kinematics));
        let w = factors.det * self.angles(kinematics).0;
        match self.measure {
            Measure::Det => w,
            Measure::Sqrt => w.sqrt(),
        }
    }

    /// `1 / cos^2 theta` and its first and second derivative by `z = -sin theta` for roll-pitch-yaw, else 1.
    fn angles(&self, kinematics: &Kinematics<'_>) -> (f64, f64, f64) {
        if self.task.kind() != TaskKind::PoseRpy {
            return (1.0, 0.0, 0.0);
        }
        let r = kinematics.pose().rotation.matrix();
        let (cos2, z) = (r[(0, 0)].powi(2) + r[(1, 0)].powi(2), r[(2, 0)]);
        // Where the rates are cut off they are constant.
        if cos2 < RPY_COSINE * RPY_COSINE {
            return (1.0 / (RPY_COSINE * RPY_COSINE), 0.0, 0.0);
        }
        let f = 1.0 / cos2;
        (f, 2.0 * z * f * f, 2.0 * f * f * (1.0 + 4.0 * z * z * f))
    }

    /// From the derivatives of w to those of the measure: `(factor, square)` of
    /// `h_k = factor w_k`, `h_kl = factor w_kl + square w_k w_l`.
    fn outer(&self, factors: &Factors, w: f64) -> (f64, f64) {
        match self.measure {
            Measure::Det => (1.0, 0.0),
            Measure::Sqrt if factors.singular => (0.0, 0.0),
            Measure::Sqrt => (0.5 / w.sqrt(), -0.25 / (w * w.sqrt())),
        }
    }
}

/// The columns of the Jacobian in the coordinates of a task, padded to six with zeros.
struct Columns<'a> {
    kinematics: &'a Kinematics<'a>,
    counts: [f64; 6],
    /// World directions of the angular coordinates.
    frame: Matrix3<f64>,
    /// Whether the tool carries `frame` along.
    carried: bool,
}

impl<'a> Columns<'a> {
    fn new(task: Task, kinematics: &'a Kinematics<'a>) -> Self {
        let kind = task.kind();
        let counts = match kind {
            TaskKind::Pose | TaskKind::PoseRpy => [1.0; 6],
            TaskKind::Position => [1.0, 1.0, 1.0, 0.0, 0.0, 0.0],
            TaskKind::Pointing => [1.0, 1.0, 1.0, 1.0, 1.0, 0.0],
            TaskKind::Planar => [1.0, 1.0, 0.0, 0.0, 0.0, 0.0],
            TaskKind::PlanarPose => [1.0, 1.0, 0.0, 0.0, 0.0, 1.0],
        };
        let carried = kind == TaskKind::Pointing;
        let frame = if carried {
            let [u, w] = task.across(kinematics.pose());
            Matrix3::from_columns(&[u, w, u.cross(&w)])
        } else {
            Matrix3::identity()
        };
        Self { kinematics, counts, frame, carried }
    }

    fn len(&self) -> usize {
        self.kinematics.jacobian().ncols()
    }

    /// A velocity in the coordinates of the task.
    #[inline(always)]
    fn coordinates(&self, linear: Vector3<f64>, angular: Vector3<f64>) -> [f64; 6] {
        let a = if self.carried { self.frame.tr_mul(&angular) } else { angular };
        let all = [linear.x, linear.y, linear.z, a.x, a.y, a.z];
        std::array::from_fn(|i| all[i] * self.counts[i])
    }

    #[inline(always)]
    fn column(&self, j: usize) -> [f64; 6] {
        self.coordinates(self.kinematics.linear(j), self.kinematics.angular(j))
    }

    /// `W dJ_j / dq_k` at `k n + j`: with `a < b`, `W [w_a x v_b; 0]` for both orders, and `W [0; w_a x w_b]` where joint
    /// a turns column b. What the tool sees, for axes that it carries along: joint b turns column a backwards.
    #[inline(always)]
    fn turned_derivatives(&self, factors: &Factors, out: &mut [[f64; 6]]) {
        let n = self.len();
        for b in 0..n {
            let (linear, angular) = (self.kinematics.linear(b), self.kinematics.angular(b));
            for a in 0..=b {
                let axis = self.kinematics.angular(a);
                let shared = factors.turned_half(0, &self.counted(0, axis.cross(&linear)));
                (out[a * n + b], out[b * n + a]) = (shared, shared);
                if a == b {
                    continue;
                }
                let turn = axis.cross(&angular);
                let own = if self.carried { self.frame.tr_mul(&turn) } else { turn };
                let own = factors.turned_half(3, &self.counted(3, own));
                let entry = if self.carried { &mut out[b * n + a] } else { &mut out[a * n + b] };
                for (entry, own) in entry.iter_mut().zip(own) {
                    *entry += own;
                }
            }
        }
    }

    /// A vector whose entries are those `first` to `first + 2` of the task, without those that do not count.
    #[inline(always)]
    fn counted(&self, first: usize, x: Vector3<f64>) -> Vector3<f64> {
        Vector3::new(x.x * self.counts[first], x.y * self.counts[first + 1], x.z * self.counts[first + 2])
    }

    /// `adj(A) column_j` as a force and a torque in world axes.
    #[inline(always)]
    fn weighed(&self, factors: &Factors, j: usize) -> (Vector3<f64>, Vector3<f64>) {
        let column = self.column(j);
        let mut p = [0.0; 6];
        for (p, row) in p.iter_mut().zip(&factors.adjugate) {
            for (a, c) in row.iter().zip(&column) {
                *p += a * c;
            }
        }
        let torque = Vector3::new(p[3], p[4], p[5]);
        (Vector3::new(p[0], p[1], p[2]), if self.carried { self.frame * torque } else { torque })
    }
}

/// What diagonalises `A = J J^T`; coordinates that do not count are padded with ones on the diagonal.
struct Factors {
    /// W, column by column.
    columns: [[f64; 6]; 6],
    /// `c_i`.
    without: [f64; 6],
    /// `c_ij`, zero on the diagonal; all equal to `det` where A is regular.
    without_two: [[f64; 6]; 6],
    adjugate: [[f64; 6]; 6],
    det: f64,
    singular: bool,
}

impl Factors {
    fn new(columns: &Columns<'_>) -> Self {
        let mut a = [[0.0; 6]; 6];
        for (i, row) in a.iter_mut().enumerate() {
            row[i] = 1.0 - columns.counts[i];
        }
        for j in 0..columns.len() {
            let column = columns.column(j);
            for (row, left) in a.iter_mut().zip(&column) {
                for (entry, right) in row.iter_mut().zip(&column) {
                    *entry += left * right;
                }
            }
        }
        let (rows, without, without_two, det, singular) = match inverse_cholesky(&a) {
            Some((rows, det)) => {
                let mut without_two = [[det; 6]; 6];
                (0..6).for_each(|i| without_two[i][i] = 0.0);
                (rows, [det; 6], without_two, det, false)
            }
            None => {
                let (rows, values) = eigen(&a);
                let product = |i: usize, j: usize| -> f64 {
                    values.iter().enumerate().filter(|(r, _)| *r != i && *r != j).map(|(_, v)| v).product()
                };
                let two = |i: usize, j: usize| if i == j { 0.0 } else { product(i, j) };
                let without_two = std::array::from_fn(|i| std::array::from_fn(|j| two(i, j)));
                (rows, std::array::from_fn(|i| product(i, i)), without_two, values.iter().product(), true)
            }
        };
        let mut adjugate = [[0.0; 6]; 6];
        for (w, c) in rows.iter().zip(&without) {
            for (out, left) in adjugate.iter_mut().zip(w) {
                let left = c * left;
                for (out, right) in out.iter_mut().zip(w) {
                    *out += left * right;
                }
            }
        }
        let columns = std::array::from_fn(|j| std::array::from_fn(|i| rows[i][j]));
        Self { columns, without, without_two, adjugate, det, singular }
    }

    /// `W x`.
    #[inline(always)]
    fn turned(&self, x: &[f64; 6]) -> [f64; 6] {
        let mut out = [0.0; 6];
        for (w, x) in self.columns.iter().zip(x) {
            for (out, w) in out.iter_mut().zip(w) {
                *out += w * x;
            }
        }
        out
    }

    /// `W [x; 0]` or `W [0; x]`, by where the three columns of W begin.
    #[inline(always)]
    fn turned_half(&self, first: usize, x: &Vector3<f64>) -> [f64; 6] {
        let mut out = [0.0; 6];
        for (w, x) in self.columns[first..first + 3].iter().zip(x.iter()) {
            for (out, w) in out.iter_mut().zip(w) {
                *out += w * x;
            }
        }
        out
    }
}

/// The inverse of the Cholesky factor of `a`, and `det(a)`; none where a pivot vanishes.
fn inverse_cholesky(a: &[[f64; 6]; 6]) -> Option<([[f64; 6]; 6], f64)> {
    let mut l = [[0.0; 6]; 6];
    let mut det = 1.0;
    for i in 0..6 {
        for j in 0..i {
            let sum: f64 = (0..j).map(|k| l[i][k] * l[j][k]).sum();
            l[i][j] = (a[i][j] - sum) / l[j][j];
        }
        let pivot = a[i][i] - (0..i).map(|k| l[i][k] * l[i][k]).sum::<f64>();
        if pivot.is_nan() || pivot <= MANIPULABILITY_PIVOT * a[i][i] {
            return None;
        }
        det *= pivot;
        l[i][i] = pivot.sqrt();
    }
    let mut w = [[0.0; 6]; 6];
    for i in 0..6 {
        let inverse = 1.0 / l[i][i];
        w[i][i] = inverse;
        for j in 0..i {
            let sum: f64 = (j..i).map(|k| l[i][k] * w[k][j]).sum();
            w[i][j] = -sum * inverse;
        }
    }
    Some((w, det))
}

/// Eigenvectors as rows, and eigenvalues, which are not negative.
fn eigen(a: &[[f64; 6]; 6]) -> ([[f64; 6]; 6], [f64; 6]) {
    let eigen = Matrix6::from_fn(|i, j| a[i][j]).symmetric_eigen();
    let rows = std::array::from_fn(|i| eigen.eigenvectors.column(i).into_owned().into());
    let largest = eigen.eigenvalues.amax();
    let value = |v: f64| if v > MANIPULABILITY_PIVOT * largest { v } else { 0.0 };
    (rows, std::array::from_fn(|i| value(eigen.eigenvalues[i])))
}

/// `tr(adj(A) A_k) = 2 sum_j P_j . d column_j / d q_k` with `P = adj(A) J`, sorted by what multiplies `v_k` and `w_k`.
fn det_gradient(columns: &Columns<'_>, factors: &Factors, out: &mut [f64]) {
    let kinematics = columns.kinematics;
    let mut after = Vector3::zeros();
    for k in (0..columns.len()).rev() {
        out[k] = 2.0 * kinematics.angular(k).dot(&after);
        let (force, torque) = columns.weighed(factors, k);
        after += kinematics.linear(k).cross(&force);
        if !columns.carried {
            after += kinematics.angular(k).cross(&torque);
        }
    }
    let (mut moment, mut carried) = (Vector3::zeros(), Vector3::zeros());
    for k in 0..columns.len() {
        let (force, torque) = columns.weighed(factors, k);
        moment += force.cross(&kinematics.angular(k));
        out[k] += 2.0 * kinematics.linear(k).dot(&moment);
        if columns.carried {
            out[k] += 2.0 * kinematics.angular(k).dot(&carried);
            carried += torque.cross(&kinematics.angular(k));
        }
    }
}

/// `sum_j P_j . d2 column_j / d q_k d q_l` for `k <= l`, handed to `add`; `p` as forces and torques.
#[inline(always)]
fn second_order(
    columns: &Columns<'_>,
    p: &[(Vector3<f64>, Vector3<f64>)],
    mut add: impl FnMut(usize, usize, f64),
) {
    let kinematics = columns.kinematics;
    let n = p.len();
    let (w, v) = (|i| kinematics.angular(i), |i| kinematics.linear(i));
    // M y - y tr M: times x it is the sum of x . (b x (a x y)) over M = sum of a b^T, the form of every term.
    let form = |m: &Matrix3<f64>, y: Vector3<f64>| m * y - y * m.trace();
    // Joints j up to k, and for carried axes those before k.
    let (mut moment, mut before) = (Vector3::zeros(), Matrix3::zeros());
    for k in 0..n {
        let (force, torque) = p[k];
        moment += force.cross(&w(k));
        let turned = moment.cross(&w(k));
        let carried = if columns.carried { form(&before.transpose(), w(k)) } else { Vector3::zeros() };
        // M w_k and tr M for the joints between.
        let (mut between, mut trace) = (Vector3::zeros(), 0.0);
        for l in k..n {
            if l > k {
                between += p[l].0 * w(l).dot(&w(k));
                trace += p[l].0.dot(&w(l));
            }
            let sum = v(l).dot(&(turned - between + w(k) * trace)) + w(l).dot(&carried);
            add(k, l, sum);
        }
        before += torque * w(k).transpose();
    }
    // Joints j beyond l.
    let mut after = Matrix3::zeros();
    for l in (0..n).rev() {
        let bent = form(&after.transpose(), w(l));
        for k in 0..=l {
            add(k, l, w(k).dot(&bent));
        }
        let (force, torque) = p[l];
        after += force * v(l).transpose();
        if !columns.carried {
            after += torque * w(l).transpose();
        }
    }
}

/// Joints up to which the intermediate results of a Hessian lie on the stack.
const STACK_JOINTS: usize = 8;

/// What a Hessian is put together from.
struct Parts<'a> {
    /// `adj(A) J` as forces and torques (n).
    weighed: &'a mut [(Vector3<f64>, Vector3<f64>)],
    /// `W J` (n).
    turned: &'a mut [[f64; 6]],
    /// `W dJ_j / dq_k` at `k n + j`.
    rates: &'a mut [[f64; 6]],
    /// `B_k` (n), see the module.
    b: &'a mut [[[f64; 6]; 6]],
}

/// The Hessian of `det(J J^T)`.
fn det_hessian(columns: &Columns<'_>, factors: &Factors, out: &mut DMatrix<f64>) {
    let zero = (Vector3::zeros(), Vector3::zeros());
    let n = columns.len();
    if n <= STACK_JOINTS {
        const N: usize = STACK_JOINTS;
        let (mut weighed, mut turned) = ([zero; N], [[0.0; 6]; N]);
        let (mut rates, mut b) = ([[0.0; 6]; N * N], [[[0.0; 6]; 6]; N]);
        let parts = Parts {
            weighed: &mut weighed[..n],
            turned: &mut turned[..n],
            rates: &mut rates[..n * n],
            b: &mut b[..n],
        };
        det_hessian_with(columns, factors, parts, out);
    } else {
        let (mut weighed, mut turned) = (vec![zero; n], vec![[0.0; 6]; n]);
        let (mut rates, mut b) = (vec![[0.0; 6]; n * n], vec![[[0.0; 6]; 6]; n]);
        let parts = Parts { weighed: &mut weighed, turned: &mut turned, rates: &mut rates, b: &mut b };
        det_hessian_with(columns, factors, parts, out);
    }
}

fn det_hessian_with(columns: &Columns<'_>, factors: &Factors, parts: Parts<'_>, out: &mut DMatrix<f64>) {
    let Parts { weighed, turned, rates, b } = parts;
    let n = columns.len();
    for j in 0..n {
        weighed[j] = columns.weighed(factors, j);
        turned[j] = factors.turned(&columns.column(j));
    }
    let entries = out.as_mut_slice();
    entries.fill(0.0);
    second_order(columns, weighed, |k, l, sum| entries[l * n + k] += 2.0 * sum);
    columns.turned_derivatives(factors, rates);
    for (b, rates) in b.iter_mut().zip(rates.chunks_exact(n)) {
        for (rate, turned) in rates.iter().zip(&*turned) {
            for (row, x) in b.iter_mut().zip(rate) {
                for (entry, y) in row.iter_mut().zip(turned) {
                    *entry += x * y;
                }
            }
        }
        for i in 0..6 {
            for j in 0..=i {
                let sum = b[i][j] + b[j][i];
                (b[i][j], b[j][i]) = (sum, sum);
            }
        }
    }
    for l in 0..n {
        let mut scaled = b[l];
        let mut diagonal = [0.0; 6];
        for ((row, c), sum) in scaled.iter_mut().zip(&factors.without_two).zip(&mut diagonal) {
            for (i, (entry, c)) in row.iter_mut().zip(c).enumerate() {
                *sum += c * b[l][i][i];
                *entry *= c;
            }
        }
        for k in 0..=l {
            let mut products = [0.0; 6];
            for (row, scaled) in b[k].iter().zip(&scaled) {
                for (product, (x, y)) in products.iter_mut().zip(row.iter().zip(scaled)) {
                    *product -= x * y;
                }
            }
            for (i, product) in products.iter_mut().enumerate() {
                *product += b[k][i][i] * diagonal[i];
            }
            let mut squares = [0.0; 6];
            for (x, y) in rates[k * n..(k + 1) * n].iter().zip(&rates[l * n..(l + 1) * n]) {
                for (s, (x, y)) in squares.iter_mut().zip(x.iter().zip(y)) {
                    *s += x * y;
                }
            }
            let mut sum = 0.0;
            for ((product, square), c) in products.iter().zip(&squares).zip(&factors.without) {
                sum += product + 2.0 * square * c;
            }
            entries[l * n + k] += sum;
            entries[k * n + l] = entries[l * n + k];
        }
    }
}

impl Criterion for Manipulability {
    fn dof(&self) -> usize {
        self.chain.dof()
    }

    fn sense(&self) -> Sense {
        Sense::Maximize
    }

    fn chain(&self) -> Option<&Chain> {
        Some(&self.chain)
    }

    fn value(&self, q: &[f64]) -> f64 {
        let mut scratch = Scratch::new(&self.chain);
        self.value_at(&self.chain.kinematics_unchecked(q, &mut scratch))
    }

    fn gradient(&self, q: &[f64], out: &mut [f64]) {
        let mut scratch = Scratch::new(&self.chain);
        self.gradient_at(q, &self.chain.kinematics_unchecked(q, &mut scratch), out);
    }

    fn gradient_at(&self, _q: &[f64], kinematics: &Kinematics<'_>, out: &mut [f64]) {
        let columns = Columns::new(self.task, kinematics);
        self.gradient_from(&columns, &Factors::new(&columns), out);
    }

    fn hessian(&self, q: &[f64], out: &mut DMatrix<f64>) {
        let mut scratch = Scratch::new(&self.chain);
        let kinematics = self.chain.kinematics_unchecked(q, &mut scratch);
        let columns = Columns::new(self.task, &kinematics);
        self.hessian_from(&columns, &Factors::new(&columns), out);
    }

    fn second_order_at(
        &self,
        _q: &[f64],
        kinematics: &Kinematics<'_>,
        gradient: &mut [f64],
        hessian: &mut DMatrix<f64>,
    ) {
        let columns = Columns::new(self.task, kinematics);
        let factors = Factors::new(&columns);
        self.gradient_from(&columns, &factors, gradient);
        self.hessian_from(&columns, &factors, hessian);
    }
}

impl Manipulability {
    fn gradient_from(&self, columns: &Columns<'_>, factors: &Factors, out: &mut [f64]) {
        let kinematics = columns.kinematics;
        det_gradient(columns, factors, out);
        let (f, f1, _) = self.angles(kinematics);
        let (factor, _) = self.outer(factors, f * factors.det);
        for (k, out) in out.iter_mut().enumerate() {
            *out *= f;
            if f1 != 0.0 {
                *out += factors.det * f1 * tilt_rate(kinematics, k);
            }
            *out *= factor;
        }
    }

    fn hessian_from(&self, columns: &Columns<'_>, factors: &Factors, out: &mut DMatrix<f64>) {
        let (n, kinematics) = (columns.len(), columns.kinematics);
        det_hessian(columns, factors, out);
        let (f, f1, f2) = self.angles(kinematics);
        let (factor, square) = self.outer(factors, f * factors.det);
        if self.task.kind() == TaskKind::PoseRpy || square != 0.0 {
            let (mut stack, mut heap) = ([0.0; STACK_JOINTS], Vec::new());
            let slope = match stack.get_mut(..n) {
                Some(slope) => slope,
                None => {
                    heap.resize(n, 0.0);
                    &mut heap[..]
                }
            };
            det_gradient(columns, factors, slope);
            let z = |k: usize| tilt_rate(kinematics, k);
            for l in 0..n {
                for k in 0..=l {
                    let bent = f2 * z(k) * z(l) + f1 * tilt_acceleration(kinematics, k, l);
                    let w = f * out[(k, l)] + f1 * (slope[k] * z(l) + slope[l] * z(k)) + factors.det * bent;
                    let [wk, wl] = [k, l].map(|i| f * slope[i] + factors.det * f1 * z(i));
                    out[(k, l)] = factor * w + square * wk * wl;
                    out[(l, k)] = out[(k, l)];
                }
            }
        } else if factor != 1.0 {
            *out *= factor;
        }
    }
}

/// `d R_zx / d q_k`: how the tool's x axis rises.
fn tilt_rate(kinematics: &Kinematics<'_>, k: usize) -> f64 {
    let x: Vector3<f64> = kinematics.pose().rotation.matrix().column(0).into();
    kinematics.angular(k).cross(&x).z
}

/// `d2 R_zx / d q_k d q_l` for `k <= l`.
fn tilt_acceleration(kinematics: &Kinematics<'_>, k: usize, l: usize) -> f64 {
    let x: Vector3<f64> = kinematics.pose().rotation.matrix().column(0).into();
    kinematics.angular(k).cross(&kinematics.angular(l).cross(&x)).z
}

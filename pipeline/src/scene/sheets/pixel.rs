//! Sheets of one pixel from the surfaces of its samples.
//!
//! 1. Of each sample the first surface left is taken. In the order of their vergence, from the nearest on, samples are members until the next
//!    is more than `gap` behind the last.
//! 2. From the members' samples all surfaces up to `gap` behind the one taken are removed (the other side of paper, a picture on a wall).
//! 3. n members take the first surface of their sample; L samples are shown by no sheet so far, at first N.
//!    L > 0, n = 0: hidden in a pixel that is not covered; no sheet. L > 0: coverage = n/L, means over these n. L = 0: coverage = members/N, means
//!    over all members. Then L −= n.
//! 4. After K sheets the samples not shown yet are added to the last one: its weights and coverage, not its vergence.
//!
//! Σ_q coverage_q Π_{p<q} (1 − coverage_p)·weights_q is the mean over the samples of the weights of what each sees first.
//! The vergence of a sheet is the mean of its vergences in the order of the samples, exact for planes.

/// Surfaces of the samples of a pixel: the vergences of all, one sample after another, each the nearest first.
#[derive(Clone, Debug, Default)]
pub struct PixelSurfaces {
    /// 1/m.
    vergence: Vec<f64>,
    /// Start of each sample's surfaces, and the end.
    start: Vec<usize>,
}

impl PixelSurfaces {
    /// Removes all samples.
    #[inline]
    pub fn clear(&mut self) {
        self.vergence.clear();
        self.start.clear();
        self.start.push(0);
    }

    /// Adds a surface to the sample that is not ended yet.
    #[inline]
    pub fn push(&mut self, vergence: f64) {
        self.vergence.push(vergence);
    }

    /// Ends a sample.
    #[inline]
    pub fn end_sample(&mut self) {
        self.start.push(self.vergence.len());
    }

    /// Number of samples.
    pub fn samples(&self) -> usize {
        self.start.len().saturating_sub(1)
    }

    /// Vergence of a surface, 1/m.
    pub fn vergence(&self, surface: usize) -> f64 {
        self.vergence[surface]
    }

    /// Numbers of the surfaces of a sample.
    pub fn of(&self, sample: usize) -> std::ops::Range<usize> {
        self.start[sample]..self.start[sample + 1]
    }
}

/// A sheet of a pixel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PixelSheet {
    /// Mean of the vergences, 1/m.
    pub vergence: f64,
    /// Share of the pixel that the sheets before it do not cover, or of the pixel for hidden ones.
    pub coverage: f64,
    /// Its members, in [`PixelSheets::members`]; the mean of their weights is that of the sheet.
    first: usize,
    end: usize,
}

/// Sheets of a pixel.
#[derive(Clone, Debug, Default)]
pub struct PixelSheets {
    sheets: Vec<PixelSheet>,
    members: Vec<(u32, usize)>,
    late: usize,
    // Of the samples: first surface left, and whether the first of all has no sheet.
    head: Vec<usize>,
    is_unseen: Vec<bool>,
    heads: Vec<f64>,
}

impl PixelSheets {
    /// Sheets, the nearest first.
    pub fn sheets(&self) -> &[PixelSheet] {
        &self.sheets
    }

    /// Members of a sheet: sample and number of the surface. Those added to the last sheet as step 4 states stand last.
    pub fn members(&self, sheet: &PixelSheet) -> &[(u32, usize)] {
        &self.members[sheet.first..sheet.end]
    }

    /// Number of samples whose first surface was added to the last sheet.
    pub fn late(&self) -> usize {
        self.late
    }

    /// Computes the first `sheets` sheets. `is_last`: step 4 applies.
    pub fn compute(&mut self, surfaces: &PixelSurfaces, sheets: usize, gap: f64, is_last: bool) {
        let n = surfaces.samples();
        self.sheets.clear();
        self.members.clear();
        self.late = 0;
        if self.is_one_sheet(surfaces, gap) {
            return;
        }
        self.head.clear();
        self.head.extend_from_slice(&surfaces.start[..n]);
        self.is_unseen.clear();
        self.is_unseen.extend((0..n).map(|i| !surfaces.of(i).is_empty()));
        let mut left = n;
        let mut before = n;
        while self.sheets.len() < sheets {
            let Some(last) = self.last_member(surfaces, gap) else { break };
            before = left;
            left = self.take(surfaces, last, gap, left);
        }
        if is_last && self.sheets.len() == sheets {
            self.add_late(surfaces, before);
        }
    }

    /// Whether each sample has one surface and all are one sheet, which is then made.
    #[inline]
    fn is_one_sheet(&mut self, surfaces: &PixelSurfaces, gap: f64) -> bool {
        let n = surfaces.samples();
        if surfaces.vergence.len() != n || !surfaces.start.iter().enumerate().all(|(i, &start)| i == start) {
            return false;
        }
        let (mut near, mut far, mut sum) = (f64::NEG_INFINITY, f64::INFINITY, 0.0);
        for &v in &surfaces.vergence {
            near = if v > near { v } else { near };
            far = if v < far { v } else { far };
            sum += v;
        }
        if near - far > gap {
            return false;
        }
        self.members.extend((0..n).map(|i| (i as u32, i)));
        self.sheets.push(PixelSheet { vergence: sum / n as f64, coverage: 1.0, first: 0, end: n });
        true
    }

    /// Vergence of the last member; `None` if no surface is left.
    #[inline]
    fn last_member(&mut self, surfaces: &PixelSurfaces, gap: f64) -> Option<f64> {
        self.heads.clear();
        let (mut near, mut far) = (f64::NEG_INFINITY, f64::INFINITY);
        for (i, &head) in self.head.iter().enumerate() {
            if head < surfaces.start[i + 1] {
                let v = surfaces.vergence[head];
                self.heads.push(v);
                near = if v > near { v } else { near };
                far = if v < far { v } else { far };
            }
        }
        if self.heads.is_empty() {
            return None;
        }
        // Differences of neighbours are not larger: all are members.
        if near - far <= gap {
            return Some(far);
        }
        self.heads.sort_unstable_by(|a, b| b.total_cmp(a));
        let mut last = self.heads[0];
        for &v in &self.heads[1..] {
            if last - v > gap {
                break;
            }
            last = v;
        }
        Some(last)
    }

    /// Takes the members, which are not farther than `last`; the samples not shown by then.
    #[inline]
    fn take(&mut self, surfaces: &PixelSurfaces, last: f64, gap: f64, left: usize) -> usize {
        let first = self.members.len();
        let (mut members, mut shown) = (0, 0);
        let (mut sum, mut sum_shown) = (0.0, 0.0);
        for i in 0..self.head.len() {
            let (mut head, end) = (self.head[i], surfaces.start[i + 1]);
            if head == end || surfaces.vergence[head] < last {
                continue;
            }
            let v = surfaces.vergence[head];
            members += 1;
            sum += v;
            if self.is_unseen[i] {
                self.is_unseen[i] = false;
                shown += 1;
                sum_shown += v;
            }
            if left == 0 || head == surfaces.start[i] {
                self.members.push((i as u32, head));
            }
            while head < end && v - surfaces.vergence[head] <= gap {
                head += 1;
            }
            self.head[i] = head;
        }
        let (coverage, vergence) = match (left, shown) {
            // Hidden in a pixel that is not covered: no sheet.
            (1.., 0) => return left,
            (1.., _) => (shown as f64 / left as f64, sum_shown / shown as f64),
            (0, _) => (members as f64 / self.head.len() as f64, sum / members as f64),
        };
        self.sheets.push(PixelSheet { vergence, coverage, first, end: self.members.len() });
        left - shown
    }

    /// Adds the samples not shown yet to the last sheet, before which `before` samples were not shown.
    fn add_late(&mut self, surfaces: &PixelSurfaces, before: usize) {
        let Some(sheet) = self.sheets.last_mut() else { return };
        let shown = sheet.end - sheet.first;
        for i in (0..self.head.len()).filter(|&i| self.is_unseen[i]) {
            self.members.push((i as u32, surfaces.start[i]));
            self.late += 1;
        }
        if self.late > 0 {
            sheet.end = self.members.len();
            sheet.coverage = (shown + self.late) as f64 / before as f64;
        }
    }
}

"""A classifier of touches in 20 lines: the label of the mean histogram that is nearest."""

import numpy as np
from sklearn.base import BaseEstimator, ClassifierMixin


class NearestTouch(ClassifierMixin, BaseEstimator):
    """What Skinmap needs: fit, predict and the kind of input."""

    input_kind = "histogram"  # or "raw", "image", "contact-geometry"

    def fit(self, X, y):
        """Remember the mean of each label."""
        self.classes_, number = np.unique(y, return_inverse=True)
        self.means_ = np.array([X[number == k].mean(axis=0) for k in range(len(self.classes_))])
        return self

    def predict(self, X):
        """Name the nearest mean."""
        gap = np.linalg.norm(np.asarray(X)[:, None] - self.means_, axis=2)
        return self.classes_[gap.argmin(axis=1)]

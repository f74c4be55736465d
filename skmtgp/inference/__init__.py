"""Inference: one file a method, and what they share.

A likelihood has ``value_and_grad(theta)``, ``fisher_information(theta)`` and
``posterior(theta)``; a posterior predicts. None of them knows of scikit-learn's
estimators, and none of them learns.
"""

"""The live web page of a run. NiceGUI is imported in view.py and serve.py alone."""
